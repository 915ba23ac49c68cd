#include "point_line_odometry/gyroscope.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "common/bounded_samples.h"
#include "geometry/se3.h"
#include "priors/prior_agreement.h"

namespace point_line_odometry {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr std::size_t kMaxImuSamples = 20000;  // 10 s of 2 kHz
constexpr double kImuKept_s = 5.0;             // before the last frame: lost frames, late samples

// Between samples that are further apart nothing is known.
constexpr double kMaxImuGap_s = 0.15;

// Change of the angular acceleration, by which rates between two samples deviate from a line.
constexpr double kJerk = 30.0;  // [rad/s^3]

// Errors of a gyroscope's scale and axes, and of the extrinsics, as a share of the angle.
constexpr double kScaleError = 0.005;

// Before anything was estimated. EuRoC's gyroscope has a bias of 0.08 rad/s.
constexpr double kFirstBias_rad_s = 0.1;  // [rad/s]
constexpr double kFirstOffset_s = 0.02;   // where the time offset is estimated
constexpr double kGivenOffset_s = 0.001;  // where it is given
constexpr double kMaxOffset_s = 0.05;
constexpr double kOffsetDrift_s = 1e-4;  // in a second

// Largest squared Mahalanobis distance of a rotation by images: 99.9 % of chi-square, 3 degrees of
// freedom. A rotation beyond it makes the state this factor more uncertain, up to the first one.
constexpr double kMaxRotationDistance = 16.27;
constexpr double kInflation = 1.2;

// Deviation of the rotation between two frames of a stationary camera [rad].
constexpr double kStandstill = 5e-5;

bool earlier(const ImuSample& a, const ImuSample& b) { return a.stamp_ns < b.stamp_ns; }

/// Linear between two samples around an instant.
Vector3d valueAt(const ImuSample& before, const ImuSample& after, std::int64_t stamp_ns,
                 Vector3d ImuSample::*value) {
  const double share =
      toSeconds(stamp_ns - before.stamp_ns) / toSeconds(after.stamp_ns - before.stamp_ns);
  return (1.0 - share) * before.*value + share * after.*value;
}

Vector3d rateAt(const ImuSample& before, const ImuSample& after, std::int64_t stamp_ns) {
  return valueAt(before, after, stamp_ns, &ImuSample::angular_velocity);
}

/// Adds a step from the rotation at its begin to that at its end.
void addForce(const Vector3d& a_begin, const Vector3d& a_end, const Matrix3d& R_begin,
              const Matrix3d& R_end, double step_s, SpecificForce* force) {
  const double middle_s = force->duration_s + 0.5 * step_s;
  const Vector3d sum = 0.5 * step_s * (R_begin * a_begin + R_end * a_end);
  const Matrix3d rotation_sum = 0.5 * step_s * (R_begin + R_end);
  force->sum += sum;
  force->moment += middle_s * sum;
  force->rotation_sum += rotation_sum;
  force->rotation_moment += middle_s * rotation_sum;
  force->squares += 0.5 * step_s * (a_begin.squaredNorm() + a_end.squaredNorm());
  force->duration_s += step_s;
}

Matrix4d firstCovariance(const ImuParameters& parameters) {
  const double offset = parameters.estimate_time_offset ? kFirstOffset_s : kGivenOffset_s;
  return Eigen::Vector4d(kFirstBias_rad_s, kFirstBias_rad_s, kFirstBias_rad_s, offset)
      .cwiseAbs2()
      .asDiagonal();
}

}  // namespace

Gyroscope::Gyroscope(const ImuParameters& parameters, const Matrix3d& R_camera_imu)
    : parameters_(parameters), R_camera_imu_(R_camera_imu) {
  startFilter();
}

void Gyroscope::startFilter() {
  state_.setZero();
  covariance_ = firstCovariance(parameters_);
  startTimeOffset();
}

void Gyroscope::startTimeOffset() {
  state_[3] = parameters_.time_offset_s;
  covariance_.row(3).setZero();
  covariance_.col(3).setZero();
  covariance_(3, 3) = firstCovariance(parameters_)(3, 3);
}

void Gyroscope::setParameters(const ImuParameters& parameters) {
  const bool other_offset = parameters.time_offset_s != parameters_.time_offset_s ||
                            parameters.estimate_time_offset != parameters_.estimate_time_offset;
  parameters_ = parameters;
  if (other_offset) startTimeOffset();
}

void Gyroscope::add(const ImuSample& sample) {
  if (!sample.angular_velocity.allFinite()) {
    ++faults_.not_finite;
    return;
  }
  if (!sample.acceleration.allFinite()) ++faults_.without_acceleration;
  if (isSaturated(sample)) ++faults_.saturated;
  insertSample(sample, std::llround(1e9 * kImuKept_s), updated_ns_, &samples_, &faults_);
  boundSamples(kMaxImuSamples, updated_ns_, &samples_);
}

bool Gyroscope::isSaturated(const ImuSample& sample) const {
  constexpr double kNearly = 0.99;
  return sample.angular_velocity.cwiseAbs().maxCoeff() >
         kNearly * parameters_.range_deg_s * M_PI / 180.0;
}

bool Gyroscope::covers(std::int64_t frame_ns) const {
  ImuSample end;
  end.stamp_ns = frame_ns + std::llround(1e9 * state_[3]);
  const auto after = std::lower_bound(samples_.begin(), samples_.end(), end, earlier);
  // A sample of far later may have a wrong stamp, and ends no interval anyway.
  return after != samples_.end() && toSeconds(after->stamp_ns - end.stamp_ns) <= kMaxImuGap_s;
}

std::optional<MotionPrior> Gyroscope::between(std::int64_t from_ns, std::int64_t to_ns) const {
  if (!isTrusted()) return std::nullopt;
  const std::optional<Rotation> rotation = integrate(from_ns, to_ns);
  return rotation ? priorOf(*rotation, from_ns, to_ns) : std::nullopt;
}

std::optional<MotionPrior> Gyroscope::priorOf(const Rotation& rotation, std::int64_t from_ns,
                                              std::int64_t to_ns) const {
  const Matrix3d covariance =
      rotation.covariance + rotation.J_state * covariance_ * rotation.J_state.transpose();
  const Eigen::LLT<Matrix3d> root(R_camera_imu_ * covariance * R_camera_imu_.transpose());
  if (root.info() != Eigen::Success) return std::nullopt;
  MotionPrior prior;
  prior.from_ns = from_ns;
  prior.to_ns = to_ns;
  prior.T_prev_curr.linear() = R_camera_imu_ * rotation.R_from_to * R_camera_imu_.transpose();
  const Matrix3d information = root.solve(Matrix3d::Identity());
  prior.information.bottomRightCorner<3, 3>() = 0.5 * (information + information.transpose());
  return prior;
}

std::optional<SpecificForce> Gyroscope::forceBetween(std::int64_t from_ns,
                                                     std::int64_t to_ns) const {
  if (!isTrusted()) return std::nullopt;
  const std::optional<Rotation> rotation = integrate(from_ns, to_ns);
  if (!rotation) return std::nullopt;
  SpecificForce force = rotation->force;
  if (!std::isfinite(force.squares)) return std::nullopt;  // no accelerometer
  force.sum = R_camera_imu_ * force.sum;
  force.moment = R_camera_imu_ * force.moment;
  force.rotation_sum = R_camera_imu_ * force.rotation_sum;
  force.rotation_moment = R_camera_imu_ * force.rotation_moment;
  return force;
}

/// Trapezoids between samples, whose rates are interpolated at both ends.
std::optional<Gyroscope::Rotation> Gyroscope::integrate(std::int64_t from_ns,
                                                        std::int64_t to_ns) const {
  const auto offset_ns = static_cast<std::int64_t>(std::llround(1e9 * state_[3]));
  const std::int64_t begin_ns = from_ns + offset_ns;
  const std::int64_t end_ns = to_ns + offset_ns;
  const auto is_earlier = [](std::int64_t ns, const ImuSample& s) { return ns < s.stamp_ns; };
  auto after = std::upper_bound(samples_.begin(), samples_.end(), begin_ns, is_earlier);
  if (after == samples_.begin() || end_ns <= begin_ns) return std::nullopt;
  Rotation rotation;
  rotation.J_state.setZero();
  double interpolation = 0.0;
  Vector3d first_rate = Vector3d::Zero();
  Vector3d rate = Vector3d::Zero();
  for (std::int64_t now_ns = begin_ns; now_ns < end_ns; ++after) {
    if (after == samples_.end()) return std::nullopt;
    const ImuSample& before = *(after - 1);
    const double gap_s = toSeconds(after->stamp_ns - before.stamp_ns);
    if (gap_s > kMaxImuGap_s || isSaturated(before) || isSaturated(*after)) return std::nullopt;
    if (now_ns == begin_ns) first_rate = rate = rateAt(before, *after, now_ns);
    const std::int64_t next_ns = std::min(after->stamp_ns, end_ns);
    const Vector3d next_rate = rateAt(before, *after, next_ns);
    const double step_s = toSeconds(next_ns - now_ns);
    rotation.J_state.leftCols<3>() -= step_s * rotation.R_from_to;
    const Matrix3d R_begin = rotation.R_from_to;
    rotation.R_from_to =
        rotation.R_from_to * expSO3(step_s * (0.5 * (rate + next_rate) - state_.head<3>()));
    addForce(valueAt(before, *after, now_ns, &ImuSample::acceleration),
             valueAt(before, *after, next_ns, &ImuSample::acceleration), R_begin,
             rotation.R_from_to, step_s, &rotation.force);
    interpolation += kJerk * gap_s * gap_s * step_s / 12.0;
    rate = next_rate;
    now_ns = next_ns;
  }
  const Vector3d bias = state_.head<3>();
  rotation.J_state.col(3) = rotation.R_from_to * (rate - bias) - (first_rate - bias);
  const double span_s = toSeconds(to_ns - from_ns);
  const double variance = std::pow(parameters_.gyroscope_noise, 2) * span_s +
                          std::pow(kScaleError * rotationAngle(rotation.R_from_to), 2) +
                          interpolation * interpolation;
  rotation.covariance = variance * Matrix3d::Identity();
  return rotation;
}

void Gyroscope::update(const FrameResult& result) {
  if (!result.accepted()) return;
  if (updated_ns_ && result.stamp_ns > *updated_ns_) {
    const double dt_s = toSeconds(result.stamp_ns - *updated_ns_);
    covariance_.diagonal().head<3>().array() +=
        std::pow(parameters_.gyroscope_random_walk, 2) * dt_s;
    if (parameters_.estimate_time_offset) covariance_(3, 3) += std::pow(kOffsetDrift_s, 2) * dt_s;
  }
  updated_ns_ = result.stamp_ns;
  if (result.state == TrackingState::kOk && result.image_motion) {
    const ImageMotion& images = *result.image_motion;
    std::optional<Rotation> rotation = integrate(images.from_ns, result.stamp_ns);
    const auto prior =
        rotation ? priorOf(*rotation, images.from_ns, result.stamp_ns) : std::nullopt;
    if (prior) {
      const bool agreed = agrees(*prior, images);
      trust_.update(agreed);
      if (!agreed && !isTrusted()) {  // the filter may have learnt something wrong
        startFilter();
        rotation = integrate(images.from_ns, result.stamp_ns);
      }
    }
    const bool stationary = result.twist.isZero(0.0);
    if (rotation && stationary) {
      correct(*rotation, Matrix3d::Identity(), kStandstill * kStandstill * Matrix3d::Identity());
    } else if (rotation) {
      const Matrix3d R_imu_camera = R_camera_imu_.transpose();
      correct(*rotation, R_imu_camera * images.T_prev_curr.linear() * R_camera_imu_,
              R_imu_camera * images.covariance.bottomRightCorner<3, 3>() * R_camera_imu_);
    }
  }
  discardBefore(result.stamp_ns - static_cast<std::int64_t>(1e9 * kImuKept_s));
}

/// Update of the Kalman filter.
void Gyroscope::correct(const Rotation& rotation, const Matrix3d& R_from_to_images,
                        const Matrix3d& covariance) {
  const Vector3d innovation = logSO3(R_from_to_images * rotation.R_from_to.transpose());
  const Eigen::Matrix<double, 3, 4>& H = rotation.J_state;
  const Matrix3d S = H * covariance_ * H.transpose() + rotation.covariance + covariance;
  const Eigen::LDLT<Matrix3d> root(S);
  const double distance = innovation.dot(root.solve(innovation));
  if (!(distance <= kMaxRotationDistance)) {
    const Matrix4d first = firstCovariance(parameters_);
    covariance_ *= kInflation;
    for (int i = 0; i < 4; ++i) {
      const double excess = covariance_(i, i) / first(i, i);
      if (excess <= 1.0) continue;
      covariance_.row(i) /= std::sqrt(excess);
      covariance_.col(i) /= std::sqrt(excess);
    }
    return;
  }
  Eigen::Matrix<double, 4, 3> gain = root.solve(H * covariance_).transpose();
  if (!parameters_.estimate_time_offset) gain.row(3).setZero();
  state_ += gain * innovation;
  state_[3] = std::clamp(state_[3], -kMaxOffset_s, kMaxOffset_s);
  // Joseph's form, which is right for a gain that is not the optimal one, too.
  const Matrix4d left = Matrix4d::Identity() - gain * H;
  covariance_ = left * covariance_ * left.transpose() +
                gain * (rotation.covariance + covariance) * gain.transpose();
  covariance_ = 0.5 * (covariance_ + covariance_.transpose()).eval();
}

void Gyroscope::discardBefore(std::int64_t stamp_ns) {
  while (!samples_.empty() && samples_.front().stamp_ns < stamp_ns) samples_.pop_front();
}

void Gyroscope::clear() {
  samples_.clear();
  updated_ns_.reset();
}

GyroscopeCalibration Gyroscope::calibration() const {
  GyroscopeCalibration calibration;
  calibration.bias = state_.head<3>();
  calibration.bias_sigma = covariance_.diagonal().head<3>().cwiseSqrt();
  calibration.time_offset_s = state_[3];
  calibration.time_offset_sigma_s = std::sqrt(covariance_(3, 3));
  return calibration;
}

}  // namespace point_line_odometry
