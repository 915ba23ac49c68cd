#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <optional>
#include <vector>

#include "map/bundle_adjustment.h"
#include "map/bundle_poses.h"
#include "motion/huber_loss.h"

namespace point_line_odometry {

/// The landmarks of one kind in a bundle adjustment: reprojection errors of their observations, and
/// their part of the normal equations, from which they are eliminated (Schur complement). All
/// matrices have fixed sizes. A landmark's parameters x are in units of its standard deviations:
/// position = value + sqrt_covariance * x.
template <typename Residual, typename Estimate, typename Observation>
class BundleLandmarks {
 public:
  using Landmark = BundleProblem::Landmark<Estimate, Observation>;

  /// All must outlive this.
  BundleLandmarks(const StereoCamera& camera, double huber_delta, std::vector<Landmark>* landmarks)
      : camera_(camera), huber_delta_(huber_delta), landmarks_(*landmarks) {}

  /// Takes all landmarks but those with an observation whose residual or Jacobians are not valid
  /// and finite: these are marked as culled. Returns whether there are any.
  bool start(const std::vector<BundlePose>& poses) {
    for (Landmark& landmark : landmarks_) {
      const auto usable = [&](const auto& seen) {
        const Term term(*this, landmark.estimate, Increment::Zero(), poses[seen.frame],
                        seen.observation);
        return term.valid && term.J_landmark.allFinite() && term.J_pose.allFinite();
      };
      landmark.culled =
          !std::all_of(landmark.observations.begin(), landmark.observations.end(), usable);
      if (landmark.culled) continue;
      blocks_.emplace_back();
      blocks_.back().landmark = &landmark;
    }
    return !blocks_.empty();
  }

  /// At the last step from the current parameters. A landmark that this would move behind a camera
  /// moves less, as else it would spoil the step of all others; nothing if it is behind one even
  /// where it was.
  std::optional<double> cost(const std::vector<BundlePose>& poses) {
    double sum = 0.0;
    for (Block& block : blocks_) {
      std::optional<double> of_block = costOf(block, poses);
      for (const double shorter : {0.5, 0.5, 0.5, 0.0}) {
        if (of_block) break;
        block.step *= shorter;
        of_block = costOf(block, poses);
      }
      if (!of_block) return std::nullopt;
      sum += *of_block;
    }
    return sum;
  }

  /// Computes the normal equations at the current parameters; adds those of the poses.
  void linearize(const std::vector<BundlePose>& poses, PoseSystem* system) {
    for (Block& block : blocks_) {
      block.H.setZero();
      block.g.setZero();
      block.coupled.clear();
      for (const auto& seen : block.landmark->observations) {
        const BundlePose& pose = poses[seen.frame];
        const Term term(*this, block.landmark->estimate, block.increment, pose, seen.observation);
        const double weight = HuberLoss(term.residual.squaredNorm(), huber_delta_).weight;
        const auto weighted_J = (weight * term.J_landmark.transpose()).eval();
        block.H += weighted_J * term.J_landmark;
        block.g += weighted_J * term.residual;
        if (pose.fixed()) continue;
        const auto weighted_J_pose = (weight * term.J_pose.transpose()).eval();
        system->add(pose.index, pose.index, weighted_J_pose * term.J_pose);
        system->addGradient(pose.index, weighted_J_pose * term.residual);
        block.coupled.push_back({pose.index, weighted_J_pose * term.J_landmark});
      }
    }
  }

  /// Eliminates the landmarks from the normal equations of the poses. \param radius see damping().
  void eliminate(double radius, PoseSystem* system) {
    for (Block& block : blocks_) {
      block.damping = damping(block.H.diagonal(), radius);
      Hessian damped = block.H;
      damped.diagonal() += block.damping;
      block.root.compute(damped);
      // With damped = L L^T: the products of H_pose_landmark L^-T are subtracted.
      const auto L = block.root.matrixL();
      const Increment white_g = L.solve(block.g);
      reduced_.clear();
      for (const Coupled& coupled : block.coupled)
        reduced_.push_back(L.solve(coupled.H.transpose()).transpose());
      for (std::size_t i = 0; i < reduced_.size(); ++i) {
        const int row = block.coupled[i].pose;
        system->addGradient(row, -reduced_[i] * white_g);
        for (std::size_t k = 0; k < reduced_.size(); ++k) {
          const int column = block.coupled[k].pose;
          if (column <= row) system->add(row, column, -reduced_[i] * reduced_[k].transpose());
        }
      }
    }
  }

  /// Sets the step that belongs to that of the poses. Returns its part of the decrease of the cost
  /// that the linearisation predicts.
  double substitute(const Eigen::VectorXd& step_of_poses) {
    double decrease = 0.0;
    for (Block& block : blocks_) {
      Increment g = block.g;
      for (const Coupled& coupled : block.coupled)
        g += coupled.H.transpose() * step_of_poses.template segment<6>(6 * coupled.pose);
      block.step = -block.root.solve(g);
      decrease += 0.5 * block.step.dot(block.damping.cwiseProduct(block.step) - block.g);
    }
    return decrease;
  }

  double largestGradient() const {
    double largest = 0.0;
    for (const Block& block : blocks_)
      largest = std::max(largest, block.g.template lpNorm<Eigen::Infinity>());
    return largest;
  }

  void acceptStep() {
    for (Block& block : blocks_) {
      block.increment += block.step;
      block.step.setZero();
    }
  }

  bool finite() const {
    return std::all_of(blocks_.begin(), blocks_.end(),
                       [](const Block& block) { return block.increment.allFinite(); });
  }

  /// Moves the landmarks.
  void apply() const {
    for (const Block& block : blocks_)
      block.landmark->estimate = at(block.landmark->estimate, block.increment);
  }

 private:
  static constexpr int kDof = Estimate::kNumDof;
  static constexpr int kRows = Residual::kRows;
  using Increment = Eigen::Matrix<double, kDof, 1>;
  using Hessian = Eigen::Matrix<double, kDof, kDof>;
  using PoseByLandmark = Eigen::Matrix<double, 6, kDof>;

  /// Block of the normal equations of a pose and a landmark.
  struct Coupled {
    int pose;
    PoseByLandmark H;
  };

  struct Block {
    Landmark* landmark;
    Increment increment = Increment::Zero();
    Increment step = Increment::Zero();
    Hessian H;
    Increment g;
    Increment damping;
    Eigen::LLT<Hessian> root;  // of H with the damping
    std::vector<Coupled> coupled;
  };

  /// Whitened residual of an observation, with its Jacobians.
  struct Term {
    Eigen::Matrix<double, kRows, 1> residual;
    Eigen::Matrix<double, kRows, kDof> J_landmark;
    Eigen::Matrix<double, kRows, 6> J_pose;
    bool valid;

    Term(const BundleLandmarks& landmarks, const Estimate& start, const Increment& increment,
         const BundlePose& pose, const Observation& observation) {
      const Residual at_pose = landmarks.residualOf(at(start, increment), pose, observation);
      valid = at_pose.valid && at_pose.value.allFinite();
      if (!valid) return;
      const double inverse_sigma = 1.0 / observation.sigma_px;
      residual = inverse_sigma * at_pose.value;
      J_landmark = inverse_sigma * (at_pose.jacobianByLandmark() * start.sqrt_covariance);
      if (pose.fixed()) {
        J_pose.setZero();
      } else {
        J_pose = inverse_sigma * pose.template byIncrement<kRows>(at_pose.jacobianByMotion());
      }
    }
  };

  /// At the block's last step. Nothing if its landmark is behind a camera.
  std::optional<double> costOf(const Block& block, const std::vector<BundlePose>& poses) const {
    const Estimate moved = at(block.landmark->estimate, block.increment + block.step);
    double sum = 0.0;
    for (const auto& seen : block.landmark->observations) {
      const Residual residual = residualOf(moved, poses[seen.frame], seen.observation);
      if (!residual.valid || !residual.value.allFinite()) return std::nullopt;
      const double sigma = seen.observation.sigma_px;
      sum += HuberLoss(residual.value.squaredNorm() / (sigma * sigma), huber_delta_).cost;
    }
    return sum;
  }

  static Estimate at(const Estimate& start, const Increment& increment) {
    Estimate moved = start;
    moved.value += start.sqrt_covariance * increment;
    return moved;
  }

  Residual residualOf(const Estimate& estimate, const BundlePose& pose,
                      const Observation& observation) const {
    return Residual(correspondence(estimate, observation), camera_, pose.T_camera_map);
  }

  const StereoCamera& camera_;
  double huber_delta_;
  std::vector<Landmark>& landmarks_;
  std::vector<Block> blocks_;
  std::vector<PoseByLandmark> reduced_;  // of one landmark, while it is eliminated
};

}  // namespace point_line_odometry
