#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "motion/landmark_refinement.h"
#include "motion/residuals.h"

namespace point_line_odometry {

/// The matches of one kind, points or lines: which of them are active in the estimate, and the
/// square-root information of their residuals. `Residual` is one of those in residuals.h.
template <typename Residual>
class WeightedMatches {
 public:
  using Correspondence = typename Residual::Correspondence;
  using SqrtInformation = Eigen::Matrix<double, Residual::kRows, Residual::kRows>;

  /// All are active. \param matches and \param camera must outlive this.
  WeightedMatches(const std::vector<Correspondence>& matches, const StereoCamera& camera)
      : given_(matches),
        matches_(matches),
        camera_(camera),
        active_(matches.size(), true),
        sqrt_information_(matches.size()) {}

  const std::vector<bool>& active() const { return active_; }
  int count() const { return static_cast<int>(std::count(active_.begin(), active_.end(), true)); }
  /// Active matches that constrain the translation: all but far points.
  int countNear() const {
    int count = 0;
    for (std::size_t i = 0; i < matches_.size(); ++i) count += active_[i] && !isFar(matches_[i]);
    return count;
  }
  const std::vector<Correspondence>& matches() const { return matches_; }
  std::size_t size() const { return matches_.size(); }

  /// Expected number of right ones among the active matches that constrain the translation, at a
  /// motion: whitened residuals of right matches are normal, those of wrong ones anywhere within
  /// the limit of selectInliers(). Without other knowledge, either is as probable.
  double expectedRightNear(const Eigen::Isometry3d& T_curr_prev, double limit) const {
    constexpr double kHalfRows = 0.5 * Residual::kRows;
    const double radius = limit * std::sqrt(static_cast<double>(Residual::kRows));
    // The volume of wrong residuals, relative to the normal distribution's at zero.
    const double volume = std::pow(0.5 * radius * radius, kHalfRows) / std::tgamma(kHalfRows + 1.0);
    double expected = 0.0;
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!active_[i] || isFar(matches_[i])) continue;
      const Residual residual = residualAt(T_curr_prev, i);
      if (!residual.valid) continue;
      const double squared = (sqrt_information_[i] * residual.value).squaredNorm();
      const double likelihood = volume * std::exp(-0.5 * squared);
      expected += likelihood / (likelihood + 1.0);
    }
    return expected;
  }

  /// Of points: moves the landmarks of active matches to where both frames make them most probable
  /// at a motion; see withRefinedLandmark(). To be followed by linearizeInformation().
  void refineLandmarks(const Eigen::Isometry3d& T_curr_prev) {
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!active_[i]) continue;
      matches_[i] = withRefinedLandmark<Residual::kResidualImages>(given_[i], camera_, T_curr_prev);
    }
  }

  /// Computes the square-root information at a motion, and drops matches that are behind the camera
  /// or not finite. Residuals of far points use its translation until the next call.
  void linearizeInformation(const Eigen::Isometry3d& T_curr_prev,
                            bool use_triangulation_covariance) {
    usable_ = active_;
    translation_of_far_ = T_curr_prev.translation();
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!active_[i]) continue;
      const Residual residual = residualAt(T_curr_prev, i);
      usable_[i] = residual.valid && residual.value.allFinite() &&
                   computeSqrtInformation(matches_[i], residual, use_triangulation_covariance,
                                          &sqrt_information_[i]);
      active_[i] = usable_[i];
    }
  }

  /// The translation by which far points are shifted.
  const Eigen::Vector3d& translationOfFar() const { return translation_of_far_; }

  /// Activates the matches whose whitened residual has |r| <= limit * sqrt(kRows), and no others.
  void selectInliers(const Eigen::Isometry3d& T_curr_prev, double limit) {
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!usable_[i]) continue;
      const Residual residual = residualAt(T_curr_prev, i);
      active_[i] = residual.valid && (sqrt_information_[i] * residual.value).squaredNorm() <=
                                         limit * limit * Residual::kRows;
    }
  }

  /// Drops the matches that constrain the translation, and activates all others that have a
  /// square-root information.
  void dropNear() {
    for (std::size_t i = 0; i < matches_.size(); ++i) usable_[i] = usable_[i] && isFar(matches_[i]);
    active_ = usable_;
  }

  /// Activates all that have a square-root information.
  void selectAll() { active_ = usable_; }

  /// Activates as active() was before.
  void select(const std::vector<bool>& active) { active_ = active; }

  /// Drops the active matches whose leverage is above a limit: the trace of J C J^T, with the
  /// whitened Jacobian J by the motion and its covariance C (the leverages of all matches add up to
  /// 6). Returns their number.
  int dropLeverage(const Eigen::Isometry3d& T_curr_prev, const Matrix6d& covariance, double limit) {
    int dropped = 0;
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!active_[i]) continue;
      const Residual residual = residualAt(T_curr_prev, i);
      if (!residual.valid) continue;
      const auto J = (sqrt_information_[i] * residual.jacobianByMotion()).eval();
      if ((J * covariance * J.transpose()).trace() <= limit) continue;
      active_[i] = false;
      ++dropped;
    }
    return dropped;
  }

  /// Drops the active matches at pixels in a part of the left image. Returns their number.
  int dropIn(const Eigen::AlignedBox2d& part_px) {
    int dropped = 0;
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!active_[i] || !part_px.contains(pixelOf(matches_[i]))) continue;
      active_[i] = false;
      ++dropped;
    }
    return dropped;
  }

  /// Sum of the squared norms of the whitened residuals of all matches, active or not, each at most
  /// `limit` times its weight: low where many agree, however wrong the others are.
  double limitedCost(const Eigen::Isometry3d& T_curr_prev, double limit,
                     const std::vector<double>& weights) const {
    double cost = 0.0;
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!usable_[i]) continue;
      const Residual residual = residualAt(T_curr_prev, i);
      const double squared =
          residual.valid ? (sqrt_information_[i] * residual.value).squaredNorm() : limit;
      cost += weights[i] * std::min(squared, limit);
    }
    return cost;
  }

  /// Activates the matches whose residual's coordinates are within a distance, and no others.
  void selectNear(const Eigen::Isometry3d& T_curr_prev, double max_distance_px) {
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!usable_[i]) continue;
      const Residual residual = residualAt(T_curr_prev, i);
      active_[i] =
          residual.valid && residual.value.template lpNorm<Eigen::Infinity>() <= max_distance_px;
    }
  }

  /// Calls visit(residual, sqrt_information, match) for each active match; false as soon as a
  /// residual is not valid.
  template <typename Visit>
  bool forEachActive(const Eigen::Isometry3d& T_curr_prev, Visit&& visit) const {
    return forEachActive(T_curr_prev, 0, matches_.size(), visit);
  }

  /// The same for the matches of indices begin ... end - 1.
  template <typename Visit>
  bool forEachActive(const Eigen::Isometry3d& T_curr_prev, std::size_t begin, std::size_t end,
                     Visit&& visit) const {
    for (std::size_t i = begin; i < end; ++i) {
      if (!active_[i]) continue;
      const Residual residual = residualAt(T_curr_prev, i);
      if (!residual.valid) return false;
      visit(residual, sqrt_information_[i], matches_[i]);
    }
    return true;
  }

 private:
  Residual residualAt(Eigen::Isometry3d T_curr_prev, std::size_t i) const {
    if (isFar(matches_[i])) T_curr_prev.translation() = translation_of_far_;
    return Residual(matches_[i], camera_, T_curr_prev);
  }

  /// Inverse Cholesky factor of the residual's covariance: pixel noise, and the triangulation's
  /// covariance propagated by the Jacobian. False if it is not finite or not positive definite.
  static bool computeSqrtInformation(const Correspondence& match, const Residual& residual,
                                     bool use_triangulation_covariance,
                                     SqrtInformation* sqrt_information) {
    SqrtInformation covariance = match.sigma_px * match.sigma_px * SqrtInformation::Identity();
    if (use_triangulation_covariance) covariance = residualCovariance(residual, match);
    if (!covariance.allFinite()) return false;
    const Eigen::LLT<SqrtInformation> cholesky(covariance);
    if (cholesky.info() != Eigen::Success) return false;
    *sqrt_information = cholesky.matrixL().solve(SqrtInformation::Identity());
    return true;
  }

  const std::vector<Correspondence>& given_;
  std::vector<Correspondence> matches_;
  const StereoCamera& camera_;
  std::vector<bool> active_;
  std::vector<bool> usable_;  // those with a square-root information
  std::vector<SqrtInformation> sqrt_information_;
  Eigen::Vector3d translation_of_far_ = Eigen::Vector3d::Zero();
};

}  // namespace point_line_odometry
