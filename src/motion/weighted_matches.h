#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <vector>

#include "motion/residuals.h"

namespace point_line_odometry {

/// The matches of one kind, points or lines: which of them take part in the estimate, and the
/// square roots of their residuals' information. `Residual` is one of those in residuals.h.
template <typename Residual>
class WeightedMatches {
 public:
  using Correspondence = typename Residual::Correspondence;
  using Weight = Eigen::Matrix<double, Residual::kRows, Residual::kRows>;

  /// All take part. \param matches and \param camera must outlive this.
  WeightedMatches(const std::vector<Correspondence>& matches, const StereoCamera& camera)
      : matches_(matches),
        camera_(camera),
        active_(matches.size(), true),
        weights_(matches.size()) {}

  const std::vector<bool>& active() const { return active_; }
  int count() const { return static_cast<int>(std::count(active_.begin(), active_.end(), true)); }
  int rows() const { return count() * Residual::kRows; }

  /// Computes the weights at a motion, and drops matches that are behind the camera or not finite.
  /// Its translation is what moves far points, until the next call.
  void linearizeWeights(const Eigen::Isometry3d& T_curr_prev, bool use_triangulation_covariance) {
    weighted_ = active_;
    translation_of_far_ = T_curr_prev.translation();
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!active_[i]) continue;
      const Residual residual = residualAt(T_curr_prev, i);
      weighted_[i] =
          residual.valid && residual.value.allFinite() &&
          computeWeight(matches_[i], residual, use_triangulation_covariance, &weights_[i]);
      active_[i] = weighted_[i];
    }
  }

  /// Takes the matches whose whitened residual is within the limit per square root of its size, and
  /// no others.
  void selectInliers(const Eigen::Isometry3d& T_curr_prev, double limit) {
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!weighted_[i]) continue;
      const Residual residual = residualAt(T_curr_prev, i);
      active_[i] = residual.valid &&
                   (weights_[i] * residual.value).squaredNorm() <= limit * limit * Residual::kRows;
    }
  }

  /// Takes all that have a weight.
  void selectAll() { active_ = weighted_; }

  /// Takes the matches whose residual's coordinates are within a distance, and no others.
  void selectNear(const Eigen::Isometry3d& T_curr_prev, double max_distance_px) {
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!weighted_[i]) continue;
      const Residual residual = residualAt(T_curr_prev, i);
      active_[i] =
          residual.valid && residual.value.template lpNorm<Eigen::Infinity>() <= max_distance_px;
    }
  }

  /// Calls visit(residual, weight, match) for each match that takes part; false as soon as a
  /// residual is not valid.
  template <typename Visit>
  bool forEachActive(const Eigen::Isometry3d& T_curr_prev, Visit&& visit) const {
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!active_[i]) continue;
      const Residual residual = residualAt(T_curr_prev, i);
      if (!residual.valid) return false;
      visit(residual, weights_[i], matches_[i]);
    }
    return true;
  }

 private:
  static bool isFar(const PointCorrespondence& point) { return point.far; }
  static bool isFar(const LineCorrespondence&) { return false; }

  Residual residualAt(Eigen::Isometry3d T_curr_prev, std::size_t i) const {
    if (isFar(matches_[i])) T_curr_prev.translation() = translation_of_far_;
    return Residual(matches_[i], camera_, T_curr_prev);
  }

  /// Inverse square root of the residual's covariance: pixel noise, and the triangulation's carried
  /// through the residual. False if it is not finite or has none.
  static bool computeWeight(const Correspondence& match, const Residual& residual,
                            bool use_triangulation_covariance, Weight* weight) {
    Weight covariance = match.sigma_px * match.sigma_px * Weight::Identity();
    if (use_triangulation_covariance) {
      const auto by_landmark = residual.byLandmark();
      covariance += by_landmark * match.covariance * by_landmark.transpose();
    }
    if (!covariance.allFinite()) return false;
    const Eigen::LLT<Weight> cholesky(covariance);
    if (cholesky.info() != Eigen::Success) return false;
    *weight = cholesky.matrixL().solve(Weight::Identity());
    return true;
  }

  const std::vector<Correspondence>& matches_;
  const StereoCamera& camera_;
  std::vector<bool> active_;
  std::vector<bool> weighted_;  // those with a weight
  std::vector<Weight> weights_;
  Eigen::Vector3d translation_of_far_ = Eigen::Vector3d::Zero();
};

}  // namespace point_line_odometry
