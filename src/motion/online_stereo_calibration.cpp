#include "motion/online_stereo_calibration.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
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

// Of the weight of information, per frame: 1 / e remains after a thousand.
constexpr double kFading = 1.0 - 1.0 / 1000.0;

// Successive frames observe the same points with the same errors: of vertical disparities, this
// many frames count as one.
constexpr double kFramesPerSample = 2.0;

// Prior standard deviations of the coefficients at the image's side [px], for
// StereoCorrection::terms(). For the disparity those of the terms without x are smaller: over two
// frames their effect on the optical flow is hardly distinguishable from that of another speed. For
// the rows those are larger by which a rotation displaces them. Calibrations are least exact at the
// image's sides: that of x^4, which is nothing elsewhere, is larger (0.1 px rms over the image).
constexpr double kFreePx = 0.1;
constexpr double kHeldPx = 0.08;
constexpr double kRotationPx = 0.3;
constexpr double kSidePx = 0.3;

StereoCorrection::Information priorInformation(const StereoCorrection::Coefficients& variance) {
  return variance.cwiseInverse().asDiagonal();
}

StereoCorrection::Information verticalPrior() {
  StereoCorrection::Coefficients sigma;
  sigma << kRotationPx, kRotationPx, kFreePx, kFreePx, kFreePx, kFreePx, kFreePx;
  return priorInformation(sigma.cwiseAbs2());
}

/// Variances of the disparity's coefficients that the rows do not show [px^2].
StereoCorrection::Coefficients calibratedVariance() {
  StereoCorrection::Coefficients sigma;
  sigma << kHeldPx, kFreePx, kHeldPx, kFreePx, kFreePx, kHeldPx, kSidePx;
  return sigma.cwiseAbs2();
}

// Standard deviation of what else than a rotation or another focal length displaces rows and
// columns by a constant (the principal point), and rows in proportion to x or y [px].
constexpr double kPrincipalPointPx = 0.3;
constexpr double kShearPx = 0.05;

// The noise of the yaw by the motions counts as so much: taken for a yaw, it costs a calibrated
// camera more than a later correction costs a knocked one.
constexpr double kNoiseOfYaw = 1.5;

// The share of new features assumed where none is known: between the 6 % of a drone and the 65 % of
// a car whose frames are 4 m apart.
constexpr double kAssumedShareOfNew = 0.35;

/// Shrinkage of a measurement by its noise: 1 - (noise / measured)^2, and 0 where the noise
/// explains it. Of a quantity about zero of unknown variance, measured with an error of this
/// standard deviation, it is the share of the measurement that is its empirical Bayes estimate, and
/// the share of the error's variance that remains.
double shrinkage(double measured, double noise) {
  const double ratio = noise / measured;
  return std::abs(measured) > noise ? 1.0 - ratio * ratio : 0.0;
}

}  // namespace

void OnlineStereoCalibration::Likelihood::add(const Information& more_information,
                                              const Coefficients& more_vector) {
  information = kFading * information + more_information;
  vector = kFading * vector + more_vector;
}

StereoCorrection::Coefficients OnlineStereoCalibration::Likelihood::mean(
    const Information& prior, const Coefficients& expected) const {
  return (prior + information).ldlt().solve(prior * expected + vector);
}

StereoCorrection::Coefficients OnlineStereoCalibration::Likelihood::variance(
    const Information& prior) const {
  return (prior + information).inverse().diagonal();
}

StereoCorrection::Information OnlineStereoCalibration::DisparityPrior::information() const {
  return priorInformation(variance_by_rows + calibratedVariance());
}

/// With w what is observed beyond the prior's mean, the means with and without the variance of a
/// calibrated camera differ by G w, and w^T G w is trace(G W) on the mean if noise with the
/// covariance W explains it all. The information claims one such covariance, the scatter of the
/// motions shows another, from two of them on. Both are too large: the former where motions count
/// for less than their points show, the latter by what the first ones show; so the smaller one
/// counts. The shrinkage of James and Stein, without the square, takes more from cameras that are
/// wrong: 1.4 instead of 1.16 times the ATE with an offset of 0.05 px.
StereoCorrection::Coefficients OnlineStereoCalibration::LikelihoodByMotions::shrunkMean(
    const DisparityPrior& prior) const {
  const Covariance prior_by_rows = prior.variance_by_rows.asDiagonal();
  const Covariance by_rows =
      prior_by_rows * (Covariance::Identity() + information * prior_by_rows).inverse();
  const Covariance G = (prior.information() + information).inverse() - by_rows;
  const Coefficients unexpected = vector - information * prior.mean;
  // Not below zero by rounding, where hardly anything was observed.
  const double by_noise = std::max(0.0, std::min((G * information).trace(), (G * scatter).trace()));
  const double share = shrinkage(unexpected.dot(G * unexpected), by_noise);
  return prior.mean + by_rows * unexpected + share * (G * unexpected);
}

OnlineStereoCalibration::OnlineStereoCalibration(const StereoCamera& camera)
    : camera_(camera), correction_(camera) {}

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
  correction_.v = v_.mean(verticalPrior(), Coefficients::Zero());
  update();
}

std::optional<CalibrationEvidence> calibrationEvidence(const Correspondences& correspondences,
                                                       const MotionEstimate& motion,
                                                       const MotionParameters& parameters,
                                                       const StereoCamera& camera,
                                                       const StereoCorrection& correction) {
  using Coefficients = StereoCorrection::Coefficients;
  using Information = StereoCorrection::Information;
  Matrix6d by_motion = Matrix6d::Zero();
  Information by_terms = Information::Zero();
  Eigen::Matrix<double, StereoCorrection::kTerms, 6> mixed =
      Eigen::Matrix<double, StereoCorrection::kTerms, 6>::Zero();
  Vector6d motion_vector = Vector6d::Zero();
  Coefficients terms_vector = Coefficients::Zero();
  for (std::size_t i = 0; i < correspondences.points.size(); ++i) {
    if (!motion.point_inliers[i] || correspondences.points[i].far) continue;
    const PointCorrespondence point = withRefinedLandmark<ResidualImages::kBoth>(
        correspondences.points[i], camera, motion.T_curr_prev);
    const PointResidual<ResidualImages::kBoth> residual(point, camera, motion.T_curr_prev);
    if (!residual.valid) continue;
    const Eigen::Matrix3d by_landmark = residual.jacobianByLandmark();
    const Eigen::Matrix3d weight = residualCovariance(residual, point).inverse();
    const double huber =
        HuberLoss(residual.value.dot(weight * residual.value), parameters.huber_delta).weight;

    // A larger correction moves the triangulated point nearer and the observed right pixel to the
    // left.
    const double disparity = camera.fx * camera.baseline_m / point.p_prev.z();
    const Eigen::Vector2d prev_right = camera.projectRight(point.p_prev);
    Eigen::Matrix<double, 3, StereoCorrection::kTerms> J =
        by_landmark * (-point.p_prev / disparity) * correction.terms(prev_right).transpose();
    J.row(2) -= correction.terms(point.right_px).transpose();
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
  if (!information.allFinite() || !vector.allFinite()) return std::nullopt;
  return CalibrationEvidence{information, information * correction.u + vector};
}

void OnlineStereoCalibration::addMotion(const CalibrationEvidence& evidence,
                                        const std::optional<double>& share_of_new) {
  if (waiting_) add(*waiting_, share_of_new.value_or(kAssumedShareOfNew), &u_);
  if (share_of_new) add(evidence, *share_of_new, &u_);
  waiting_ = share_of_new ? std::nullopt : std::make_optional(evidence);
  update();
}

/// One factor is for the points that repeat their errors, two for the error that all have in
/// common: on the disparity it acts inversely to the motion, and on the information by its square.
/// To the scatter a motion adds the square of what it shows, with that of its weight, divided by
/// the share as it repeats what others showed. A yaw that it is the first to show is no scatter.
void OnlineStereoCalibration::add(const CalibrationEvidence& motion, double share_of_new,
                                  LikelihoodByMotions* u) const {
  const Likelihood before = *u;
  const double weight = std::pow(share_of_new, 3);
  u->add(weight * motion.information, weight * motion.vector);
  const DisparityPrior prior = disparityPrior(*u);
  const Coefficients unexpected =
      motion.vector - motion.information * before.mean(prior.information(), prior.mean);
  u->scatter = kFading * kFading * u->scatter +
               weight * std::pow(share_of_new, 2) * unexpected * unexpected.transpose();
}

void OnlineStereoCalibration::update() {
  LikelihoodByMotions u = u_;
  if (waiting_) add(*waiting_, kAssumedShareOfNew, &u);
  const DisparityPrior prior = disparityPrior(u);
  correction_.u = u.shrunkMean(prior);
  correction_.disparity_error_px = std::hypot(StereoCorrection::kCalibratedPx, prior.yaw_sigma_px);
}

OnlineStereoCalibration::DisparityPrior OnlineStereoCalibration::disparityPrior(
    const Likelihood& u) const {
  const Coefficients v_variance = v_.variance(verticalPrior());
  DisparityPrior prior = expectedByRows(v_variance);
  const Yaw yaw = this->yaw(u, prior);
  prior.mean += yaw.u;
  prior.variance_by_rows[5] += std::pow(tangentialPx(yaw, v_variance), 2);
  prior.yaw_sigma_px = yaw.sigma_px;
  return prior;
}

bool OnlineStereoCalibration::knowsVertical() const {
  constexpr double kLeast = 9.0;  // some ten stereo matches
  return v_.information(0, 0) > kLeast * verticalPrior()(0, 0);
}

/// Lenses displace rows by as much as the coefficients of v show, but for those by which a rotation
/// displaces most; the median, as another may be large (KITTI's x y is 5 px).
double OnlineStereoCalibration::lensErrorPx() const {
  const Coefficients& v = correction_.v;
  return median(
      std::vector<double>{std::abs(v[2]), std::abs(v[3]), std::abs(v[4]), std::abs(v[5])});
}

/// To first order a roll w displaces a pixel (x, y) from the principal point by w (-y fx / fy,
/// x fy / fx), a pitch w by w (x y / fy, fy + y^2 / fy), and a focal length longer by the share s
/// by s (x, y). The rows cannot tell a yaw from what lenses do.
OnlineStereoCalibration::DisparityPrior OnlineStereoCalibration::expectedByRows(
    const Coefficients& v_variance) const {
  const Coefficients& v = correction_.v;
  const double lens_px = lensErrorPx();
  DisparityPrior by_rows;
  const auto expect = [&](int term_of_u, double factor, int term, double other_px) {
    const double sigma_px = std::hypot(std::sqrt(v_variance[term]), lens_px, other_px);
    const double gain = shrinkage(v[term], sigma_px);
    if (gain == 0.0) return;
    by_rows.mean[term_of_u] = factor * gain * v[term];
    by_rows.variance_by_rows[term_of_u] = gain * std::pow(factor * sigma_px, 2);
  };
  const double aspect = camera_.fx / camera_.fy;
  const double k = 0.5 * camera_.width / camera_.fy;
  expect(1, 1.0, 2, kShearPx);
  expect(2, -aspect * aspect, 1, kShearPx);
  expect(4, k * k, 0, kPrincipalPointPx);
  return by_rows;
}

/// To first order a yaw w displaces columns by w (fx + x^2 / fx). What the motions show of u is a
/// multiple of that, and beyond it what the prior allows: also of what a lens does, whose error is
/// therefore not in the standard deviation.
OnlineStereoCalibration::Yaw OnlineStereoCalibration::yaw(const Likelihood& u,
                                                          const DisparityPrior& by_rows) const {
  const Information prior = by_rows.information();
  const double k = 0.5 * camera_.width / camera_.fx;
  Coefficients shape = Coefficients::Zero();
  shape[0] = 1.0 + k * k / 3.0;
  shape[3] = k * k;
  const Coefficients weighted = prior * shape;
  const Eigen::LDLT<Information> solver(prior + u.information);
  const double information = weighted.dot(shape - solver.solve(weighted));
  if (!(information > 0.0)) return {};
  const Coefficients unexplained = u.vector - u.information * by_rows.mean;
  const double measured_px = weighted.dot(solver.solve(unexplained)) / information;
  const double noise_px = kNoiseOfYaw / std::sqrt(information);
  const double gain =
      shrinkage(measured_px, std::hypot(noise_px, lensErrorPx(), kPrincipalPointPx));
  return {gain * measured_px * shape, std::sqrt(gain) * noise_px * shape[0]};
}

/// Tangential distortion p displaces columns by p (3 x^2 + y^2) and rows by 2 p x y, a yaw w
/// columns by w x^2 and rows by w x y. Where a calibration has made the disparities of the central
/// row right by w = -3 p, p y^2 is left of the columns, and -p x y of the rows.
double OnlineStereoCalibration::tangentialPx(const Yaw& yaw, const Coefficients& v_variance) const {
  const double aspect = camera_.fx / camera_.fy;
  const double square = std::pow(correction_.v[4] - yaw.u[3], 2) - v_variance[4];
  return square > 0.0 ? aspect * aspect * std::sqrt(square) : 0.0;
}

}  // namespace point_line_odometry
