#include "motion/online_stereo_calibration.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "common/statistics.h"
#include "motion/huber_loss.h"
#include "motion/landmark_refinement.h"
#include "motion/residuals.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {
namespace {

constexpr double kMemoryFrames =
    1000.0;  // after which the weight of information has decayed to 1/e

// Successive frames observe the same points with the same errors: of vertical disparities, this
// many frames count as one.
constexpr double kFramesPerSample = 2.0;

// Prior standard deviations of the coefficients at the image's side [px], for
// StereoCorrection::terms(). For the disparity those of the terms without x are smaller: over two
// frames their effect on the optical flow is hardly distinguishable from that of another speed. For
// the rows those are larger by which a rotation displaces them.
constexpr double kFreePx = 0.1;
constexpr double kHeldPx = 0.08;
constexpr double kRotationPx = 0.3;
StereoCorrection::Coefficients verticalSigma() {
  StereoCorrection::Coefficients sigma;
  sigma << kRotationPx, kRotationPx, kFreePx, kFreePx, kFreePx, kFreePx;
  return sigma;
}
StereoCorrection::Coefficients disparitySigma() {
  StereoCorrection::Coefficients sigma;
  sigma << kHeldPx, kFreePx, kHeldPx, kFreePx, kFreePx, kHeldPx;
  return sigma;
}

// Standard deviation of what else than a rotation displaces rows by a constant (the principal
// point), or in proportion to x [px].
constexpr double kPrincipalPointPx = 0.3;
constexpr double kShearPx = 0.05;

/// A quantity about zero of unknown variance, measured with an error of this standard deviation:
/// its empirical Bayes estimate, which is zero where the error explains the measurement.
double shrunk(double measured, double sigma) {
  const double ratio = sigma / measured;
  return std::abs(measured) > sigma ? measured * (1.0 - ratio * ratio) : 0.0;
}

}  // namespace

OnlineStereoCalibration::GaussianEstimate::GaussianEstimate(const Coefficients& prior_sigma)
    : prior(prior_sigma.cwiseAbs2().cwiseInverse().asDiagonal()), information(prior) {}

void OnlineStereoCalibration::GaussianEstimate::add(const Information& more_information,
                                                    const Coefficients& more_vector) {
  const double fading = 1.0 - 1.0 / kMemoryFrames;
  information = prior + fading * (information - prior) + more_information;
  vector = fading * vector + more_vector;
}

StereoCorrection::Coefficients OnlineStereoCalibration::GaussianEstimate::mean(
    const Coefficients& expected) const {
  return information.ldlt().solve(prior * expected + vector);
}

OnlineStereoCalibration::OnlineStereoCalibration(const StereoCamera& camera)
    : camera_(camera), correction_(camera), u_(disparitySigma()), v_(verticalSigma()) {}

std::vector<OnlineStereoCalibration::VerticalDisparity> verticalDisparities(
    const StereoFrame& frame) {
  std::vector<OnlineStereoCalibration::VerticalDisparity> samples;
  samples.reserve(frame.points.size());
  for (const StereoPoint& point : frame.points) {
    const Eigen::Vector2f& left_px = frame.features.points_left[point.left].pixel;
    samples.push_back(
        {point.right_px.cast<double>(), static_cast<double>(point.right_px.y() - left_px.y())});
  }
  return samples;
}

void OnlineStereoCalibration::addVerticalDisparities(const std::vector<VerticalDisparity>& samples,
                                                     double sigma_px) {
  Information information = Information::Zero();
  Coefficients vector = Coefficients::Zero();
  for (const VerticalDisparity& sample : samples) {
    const Coefficients terms = correction_.terms(sample.right_px);
    const double residual = sample.vertical_disparity_px - correction_.v.dot(terms);
    const double weight =
        std::min(1.0, 3.0 * sigma_px / std::max(std::abs(residual), 1e-9)) / (sigma_px * sigma_px);
    information += weight * terms * terms.transpose();
    vector += weight * sample.vertical_disparity_px * terms;
  }
  v_.add(information / kFramesPerSample, vector / kFramesPerSample);
  correction_.v = v_.mean();
  correction_.u = u_.mean(expectedByRotation());
}

void OnlineStereoCalibration::addMotion(const Correspondences& correspondences,
                                        const MotionEstimate& motion,
                                        const MotionParameters& parameters,
                                        const std::optional<double>& share_of_new) {
  Matrix6d by_motion = Matrix6d::Zero();
  Information by_terms = Information::Zero();
  Eigen::Matrix<double, StereoCorrection::kTerms, 6> mixed =
      Eigen::Matrix<double, StereoCorrection::kTerms, 6>::Zero();
  Vector6d motion_vector = Vector6d::Zero();
  Coefficients terms_vector = Coefficients::Zero();
  for (std::size_t i = 0; i < correspondences.points.size(); ++i) {
    if (!motion.point_inliers[i] || correspondences.points[i].far) continue;
    const PointCorrespondence point = withRefinedLandmark<ResidualImages::kBoth>(
        correspondences.points[i], camera_, motion.T_curr_prev);
    const PointResidual<ResidualImages::kBoth> residual(point, camera_, motion.T_curr_prev);
    if (!residual.valid) continue;
    const Eigen::Matrix3d by_landmark = residual.jacobianByLandmark();
    const Eigen::Matrix3d weight = residualCovariance(residual, point).inverse();
    const double huber =
        HuberLoss(residual.value.dot(weight * residual.value), parameters.huber_delta).weight;

    // A larger correction moves the triangulated point nearer and the observed right pixel to the
    // left.
    const double disparity = camera_.fx * camera_.baseline_m / point.p_prev.z();
    const Eigen::Vector2d prev_right = camera_.projectRight(point.p_prev);
    Eigen::Matrix<double, 3, StereoCorrection::kTerms> J =
        by_landmark * (-point.p_prev / disparity) * correction_.terms(prev_right).transpose();
    J.row(2) -= correction_.terms(point.right_px).transpose();
    const Eigen::Matrix<double, 3, 6> J_motion = residual.jacobianByMotion();
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

/// Once for the points that repeat their errors. Twice for the error that all have in common: on
/// the disparity it acts inversely to the motion, and on the information by its square.
void OnlineStereoCalibration::add(const CalibrationEvidence& evidence, double share_of_new) {
  const double weight = std::pow(share_of_new, 3);
  u_.add(weight * evidence.information, weight * evidence.vector);
  correction_.u = u_.mean(expectedByRotation());
}

bool OnlineStereoCalibration::knowsVertical() const {
  constexpr double kLeast = 10.0;  // some ten stereo matches
  return v_.information(0, 0) > kLeast * v_.prior(0, 0);
}

/// To first order a roll w displaces a pixel (x, y) from the principal point by w (-y fx / fy,
/// x fy / fx), and a pitch w by w (x y / fy, fy + y^2 / fy). Lenses displace rows, too: as much as
/// the other coefficients of v show, but for the largest (KITTI's x y is 5 px). A yaw cannot be
/// told from that.
StereoCorrection::Coefficients OnlineStereoCalibration::expectedByRotation() const {
  const Coefficients& v = correction_.v;
  const double by_lens =
      median(std::vector<double>{std::abs(v[2]), std::abs(v[3]), std::abs(v[4]), std::abs(v[5])});
  const Coefficients variance = v_.information.inverse().diagonal();
  const auto sigma = [&](int term, double other_px) {
    return std::sqrt(variance[term] + by_lens * by_lens + other_px * other_px);
  };
  const double aspect = camera_.fx / camera_.fy;
  const double k = 0.5 * camera_.width / camera_.fy;
  Coefficients u = Coefficients::Zero();
  u[2] = -aspect * aspect * shrunk(v[1], sigma(1, kShearPx));
  u[4] = k * k * shrunk(v[0], sigma(0, kPrincipalPointPx));
  return u;
}

}  // namespace point_line_odometry
