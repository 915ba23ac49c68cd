#include "point_line_odometry/calibration_refinement.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "motion/residuals.h"

namespace point_line_odometry {
namespace {

constexpr double kMemoryFrames = 1000.0;  // after which information has faded to 1/e

// Successive frames see the same points, with the same errors: of rows, this many count as one.
constexpr double kFramesPerSample = 2.0;

// What a calibration may be wrong by at the image's side [px], for RightImageCorrection::terms().
// Of the disparity, the terms without x are held more: over two frames their effect on the flow is
// hardly distinguished from that of a wrong speed.
constexpr double kFreePx = 0.1;
constexpr double kHeldPx = 0.05;
RightImageCorrection::Coefficients disparitySigma() {
  RightImageCorrection::Coefficients sigma;
  sigma << kHeldPx, kFreePx, kHeldPx, kFreePx, kFreePx, kHeldPx;
  return sigma;
}

}  // namespace

RightImageCorrection::Coefficients RightImageCorrection::terms(
    const Eigen::Vector2d& right_px) const {
  const double x = scale_ * (right_px.x() - centre_.x());
  const double y = scale_ * (right_px.y() - centre_.y());
  Coefficients terms;
  terms << 1.0, x, y, x * x - 1.0 / 3.0, x * y, y * y;
  return terms;
}

Eigen::Vector2d RightImageCorrection::apply(const Eigen::Vector2d& right_px) const {
  const Coefficients t = terms(right_px);
  return {right_px.x() - u.dot(t), right_px.y() - v.dot(t)};
}

CalibrationRefinement::Belief::Belief(const Coefficients& prior_sigma)
    : prior(prior_sigma.cwiseAbs2().cwiseInverse().asDiagonal()), information(prior) {}

void CalibrationRefinement::Belief::add(const Information& more_information,
                                        const Coefficients& more_vector) {
  const double fading = 1.0 - 1.0 / kMemoryFrames;
  information = prior + fading * (information - prior) + more_information;
  vector = fading * vector + more_vector;
}

RightImageCorrection::Coefficients CalibrationRefinement::Belief::mean() const {
  return information.ldlt().solve(vector);
}

CalibrationRefinement::CalibrationRefinement(const StereoCamera& camera)
    : camera_(camera),
      correction_(camera),
      u_(disparitySigma()),
      v_(Coefficients::Constant(kFreePx)) {}

void CalibrationRefinement::addRows(const std::vector<RowSample>& samples, double sigma_px) {
  Information information = Information::Zero();
  Coefficients vector = Coefficients::Zero();
  for (const RowSample& sample : samples) {
    const Coefficients terms = correction_.terms(sample.right_px);
    const double residual = sample.row_difference_px - correction_.v.dot(terms);
    const double weight =
        std::min(1.0, 3.0 * sigma_px / std::max(std::abs(residual), 1e-9)) / (sigma_px * sigma_px);
    information += weight * terms * terms.transpose();
    vector += weight * sample.row_difference_px * terms;
  }
  v_.add(information / kFramesPerSample, vector / kFramesPerSample);
  correction_.v = v_.mean();
}

void CalibrationRefinement::addMotion(const Correspondences& correspondences,
                                      const MotionEstimate& motion,
                                      const MotionParameters& parameters,
                                      const std::optional<double>& share_of_new) {
  Matrix6d by_motion = Matrix6d::Zero();
  Information by_terms = Information::Zero();
  Eigen::Matrix<double, RightImageCorrection::kTerms, 6> mixed =
      Eigen::Matrix<double, RightImageCorrection::kTerms, 6>::Zero();
  Vector6d motion_vector = Vector6d::Zero();
  Coefficients terms_vector = Coefficients::Zero();
  for (std::size_t i = 0; i < correspondences.points.size(); ++i) {
    const PointCorrespondence& point = correspondences.points[i];
    if (!motion.point_inliers[i] || point.far) continue;
    const PointResidual<ResidualImages::kBoth> residual(point, camera_, motion.T_curr_prev);
    if (!residual.valid) continue;
    const Eigen::Matrix3d by_landmark = residual.byLandmark();
    Eigen::Matrix3d covariance = by_landmark * point.covariance * by_landmark.transpose();
    covariance.diagonal().array() += point.sigma_px * point.sigma_px;
    const Eigen::Matrix3d weight = covariance.inverse();
    const double norm = std::sqrt(residual.value.dot(weight * residual.value));
    const double huber = norm > parameters.huber_delta ? parameters.huber_delta / norm : 1.0;

    // A larger correction moves the triangulated point nearer and the observed right pixel to the
    // left.
    const double disparity = camera_.fx * camera_.baseline_m / point.p_prev.z();
    const Eigen::Vector2d prev_right = camera_.projectRight(point.p_prev);
    Eigen::Matrix<double, 3, RightImageCorrection::kTerms> J =
        by_landmark * (-point.p_prev / disparity) * correction_.terms(prev_right).transpose();
    J.row(2) -= correction_.terms(point.right_px).transpose();
    const Eigen::Matrix<double, 3, 6> J_motion = residual.byMotion();
    const Eigen::Vector3d r = residual.value;
    by_motion += huber * J_motion.transpose() * weight * J_motion;
    by_terms += huber * J.transpose() * weight * J;
    mixed += huber * J.transpose() * weight * J_motion;
    motion_vector -= huber * J_motion.transpose() * weight * r;
    terms_vector -= huber * J.transpose() * weight * r;
  }
  const Eigen::LDLT<Matrix6d> solver(by_motion + 1e-9 * by_motion.trace() * Matrix6d::Identity());
  const Information information = by_terms - mixed * solver.solve(mixed.transpose());
  const Coefficients vector = terms_vector - mixed * solver.solve(motion_vector);
  if (!information.allFinite() || !vector.allFinite()) return;
  const CalibrationEvidence evidence{information, information * correction_.u + vector};
  if (share_of_new && waiting_) add(*waiting_, *share_of_new);
  waiting_ = share_of_new ? std::nullopt : std::make_optional(evidence);
  if (share_of_new) add(evidence, *share_of_new);
}

void CalibrationRefinement::add(const CalibrationEvidence& evidence, double share_of_new) {
  const double weight = share_of_new * share_of_new;
  u_.add(weight * evidence.information, weight * evidence.vector);
  correction_.u = u_.mean();
}

}  // namespace point_line_odometry
