#include "point_line_odometry/wheel_odometry.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/bounded_samples.h"
#include "geometry/se3.h"
#include "priors/prior_agreement.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr std::size_t kMaxWheelSamples = 20000;  // 100 s of 200 Hz
constexpr double kWheelsKept_s = 15.0;           // before the last frame: dark frames, late samples

// A pose is interpolated between samples that are not further apart.
constexpr double kMaxWheelGap_s = 0.5;

// Accelerations, by which poses between two samples deviate from their interpolation.
constexpr double kAcceleration = 3.0;         // [m/s^2]
constexpr double kAngularAcceleration = 3.0;  // [rad/s^2]

// A step that differs by more from that at the velocity before is a jump of the pose: by this, by
// errors of the stamps and by an acceleration.
constexpr double kJump = 0.05;  // [m], [rad]
constexpr double kStampError_s = 0.02;
constexpr double kJumpAcceleration = 30.0;  // [m/s^2], [rad/s^2]
constexpr double kShortestStep_s = 0.01;    // for a velocity

// Deviations of a robot's velocity from that of its wheels, along and about axes that these do not
// measure: they stand on the ground. Without any, a change of the speed could be a pitching camera.
constexpr double kSway_m_s = 0.3;
constexpr double kSway_rad_s = 0.3;

// Of the source's variances.
constexpr double kSmallestVariance = 1e-12;
constexpr double kUnknownVariance = 1e3;

std::int64_t nanoseconds(double s) { return static_cast<std::int64_t>(std::llround(1e9 * s)); }

bool isEarlier(const OdometrySample& sample, std::int64_t stamp_ns) {
  return sample.stamp_ns < stamp_ns;
}

bool isUsable(const OdometrySample& sample) {
  constexpr double kTolerance = 1e-6;
  const Eigen::Matrix3d R = sample.T_odom_body.linear();
  return sample.T_odom_body.matrix().allFinite() && (R * R.transpose()).isIdentity(kTolerance) &&
         R.determinant() > 0.0;
}

/// Linear in position and angle.
Isometry3d interpolate(const Isometry3d& from, const Isometry3d& to, double share) {
  Isometry3d pose = Isometry3d::Identity();
  pose.linear() = from.linear() * expSO3(share * logSO3(from.linear().transpose() * to.linear()));
  pose.translation() = (1.0 - share) * from.translation() + share * to.translation();
  return pose;
}

/// Between two samples, in the axes of the odometry.
Vector6d velocityBetween(const OdometrySample& from, const OdometrySample& to) {
  const double dt_s = std::max(toSeconds(to.stamp_ns - from.stamp_ns), kShortestStep_s);
  return poseDifference(from.T_odom_body, to.T_odom_body) / dt_s;
}

/// Whether a step of some duration, in metres or radians, is none of a body that had this velocity.
bool isJump(const Vector3d& step, double dt_s, const Vector3d& velocity_before) {
  const double most =
      kJump + kStampError_s * velocity_before.norm() + 0.5 * kJumpAcceleration * dt_s * dt_s;
  return (step - dt_s * velocity_before).norm() > most;
}

/// Whether a variance is one, and not that of an axis that is not measured.
bool isGiven(double variance) { return variance > kSmallestVariance; }
bool isUnknown(double variance) { return variance >= kUnknownVariance; }

MotionPrior priorOfBody(const Isometry3d& motion, const Vector6d& deviations, std::int64_t from_ns,
                        std::int64_t to_ns) {
  MotionPrior prior;
  prior.from_ns = from_ns;
  prior.to_ns = to_ns;
  prior.T_prev_curr = motion;
  for (int i = 0; i < 6; ++i) {
    if (deviations[i] > 0.0) prior.information(i, i) = 1.0 / (deviations[i] * deviations[i]);
  }
  return prior;
}

/// Whether priors can be compared with a frame's motion by the images.
bool isComparable(const FrameResult& result) {
  return result.state == TrackingState::kOk && result.image_motion;
}

}  // namespace

WheelOdometry::WheelOdometry(const Parameters& parameters, const Isometry3d& T_body_camera)
    : parameters_(parameters), T_body_camera_(T_body_camera) {}

void WheelOdometry::setParameters(const Parameters& parameters) { parameters_ = parameters; }

void WheelOdometry::add(const OdometrySample& sample) {
  if (!isUsable(sample)) {
    ++faults_.not_finite;
    return;
  }
  insertSample(sample, std::llround(1e9 * kWheelsKept_s), updated_ns_, &samples_, &faults_);
  boundSamples(kMaxWheelSamples, updated_ns_, &samples_);
}

bool WheelOdometry::covers(std::int64_t frame_ns) const {
  const auto after = std::lower_bound(samples_.begin(), samples_.end(), frame_ns, isEarlier);
  // A sample of far later may have a wrong stamp, and ends no interval anyway.
  return after != samples_.end() && toSeconds(after->stamp_ns - frame_ns) <= kMaxWheelGap_s;
}

/// \param gap_s gets the time between the samples around it, 0 at a sample.
std::optional<Isometry3d> WheelOdometry::poseAt(std::int64_t stamp_ns, double* gap_s) const {
  *gap_s = 0.0;
  const auto after = std::lower_bound(samples_.begin(), samples_.end(), stamp_ns, isEarlier);
  if (after == samples_.end()) return std::nullopt;
  if (after->stamp_ns == stamp_ns) return after->T_odom_body;
  if (after == samples_.begin()) return std::nullopt;
  const OdometrySample& before = *(after - 1);
  *gap_s = toSeconds(after->stamp_ns - before.stamp_ns);
  if (*gap_s > kMaxWheelGap_s) return std::nullopt;
  return interpolate(before.T_odom_body, after->T_odom_body,
                     toSeconds(stamp_ns - before.stamp_ns) / *gap_s);
}

/// True if a step between two samples of the interval is impossible.
bool WheelOdometry::jumps(std::int64_t from_ns, std::int64_t to_ns) const {
  const TrackingParameters& limits = parameters_.tracking;
  auto to = std::upper_bound(
      samples_.begin(), samples_.end(), from_ns,
      [](std::int64_t ns, const OdometrySample& sample) { return ns < sample.stamp_ns; });
  for (; to != samples_.end() && to != samples_.begin(); ++to) {
    const OdometrySample& from = *(to - 1);
    if (from.stamp_ns >= to_ns) break;
    const Vector6d velocity = velocityBetween(from, *to);
    if (velocity.head<3>().norm() > limits.max_speed_m_s ||
        velocity.tail<3>().norm() > limits.max_turn_rate_deg_s * M_PI / 180.0)
      return true;
    if (to - 1 == samples_.begin()) continue;
    const Vector6d before = velocityBetween(*(to - 2), from);
    const double dt_s = std::max(toSeconds(to->stamp_ns - from.stamp_ns), kShortestStep_s);
    const Vector6d step = dt_s * velocity;
    if (isJump(step.head<3>(), dt_s, before.head<3>()) ||
        isJump(step.tail<3>(), dt_s, before.tail<3>()))
      return true;
  }
  return false;
}

/// Of the samples in and around an interval; an axis that one of them does not know is unknown.
Vector6d WheelOdometry::meanVariance(std::int64_t from_ns, std::int64_t to_ns) const {
  const double turn = std::pow(parameters_.wheels.turn_noise, 2);
  const double speed = std::pow(parameters_.wheels.speed_noise, 2);
  Vector6d defaults;
  defaults << speed, speed, kUnknownVariance, kUnknownVariance, kUnknownVariance, turn;
  Vector6d sum = Vector6d::Zero();
  Vector6d largest = Vector6d::Zero();
  int count = 0;
  auto sample = std::lower_bound(samples_.begin(), samples_.end(), from_ns, isEarlier);
  if (sample != samples_.begin()) --sample;
  for (; sample != samples_.end(); ++sample) {
    Vector6d variance = sample->twist_variance;
    for (int i = 0; i < 6; ++i) {
      if (!isGiven(variance[i])) variance[i] = defaults[i];
    }
    sum += variance;
    largest = largest.cwiseMax(variance);
    ++count;
    if (sample->stamp_ns >= to_ns) break;
  }
  Vector6d mean = sum / std::max(count, 1);
  for (int i = 0; i < 6; ++i) {
    if (isUnknown(largest[i])) mean[i] = kUnknownVariance;
  }
  return mean;
}

/// Standard deviations of a motion along and about the axes of the body; 0: unknown.
Vector6d WheelOdometry::deviations(const Isometry3d& motion, std::int64_t from_ns,
                                   std::int64_t to_ns, double gap_s) const {
  const WheelParameters& wheels = parameters_.wheels;
  const double span_s = toSeconds(to_ns - from_ns);
  const double way_m = motion.translation().norm();
  const double turn_rad = rotationAngle(motion.linear());
  Vector6d slip;
  slip << wheels.slip_x * way_m, wheels.slip_y * way_m, wheels.slip_y * way_m,
      wheels.slip_yaw * turn_rad, wheels.slip_yaw * turn_rad, wheels.slip_yaw * turn_rad;
  // Of an interpolation, at most an eighth of the acceleration times the squared gap.
  Vector6d interpolation;
  interpolation << Vector3d::Constant(kAcceleration), Vector3d::Constant(kAngularAcceleration);
  interpolation *= 0.125 * gap_s * gap_s;
  Vector6d variance = meanVariance(from_ns, to_ns);
  if (isUnknown(variance[0]) && isUnknown(variance[1]) && isUnknown(variance[5]))
    return Vector6d::Zero();
  for (int i = 2; i <= 4; ++i) {
    if (isUnknown(variance[i])) variance[i] = std::pow(i == 2 ? kSway_m_s : kSway_rad_s, 2);
  }
  Vector6d result = Vector6d::Zero();
  for (int i = 0; i < 6; ++i) {
    // The floor is known by planarPrior(): these axes of a planar odometry say the same.
    const bool of_floor = i >= 2 && i <= 4 && parameters_.planar.enabled;
    if (of_floor || isUnknown(variance[i])) continue;
    result[i] = std::sqrt(variance[i] * span_s * span_s + slip[i] * slip[i] +
                          interpolation[i] * interpolation[i]);
  }
  return result;
}

std::optional<MotionPrior> WheelOdometry::measure(std::int64_t from_ns, std::int64_t to_ns) const {
  if (to_ns <= from_ns) return std::nullopt;
  double gap_from_s = 0.0;
  double gap_to_s = 0.0;
  const std::optional<Isometry3d> from = poseAt(from_ns, &gap_from_s);
  const std::optional<Isometry3d> to = poseAt(to_ns, &gap_to_s);
  if (!from || !to || jumps(from_ns, to_ns)) return std::nullopt;
  Isometry3d motion = from->inverse() * *to;
  motion.linear() = Eigen::Quaterniond(motion.linear()).normalized().toRotationMatrix();
  const Vector6d of_body = deviations(motion, from_ns, to_ns, std::hypot(gap_from_s, gap_to_s));
  if (of_body.isZero(0.0)) return std::nullopt;
  return ofCamera(priorOfBody(motion, of_body, from_ns, to_ns), T_body_camera_);
}

std::optional<MotionPrior> WheelOdometry::between(std::int64_t from_ns, std::int64_t to_ns) const {
  return isTrusted() ? measure(from_ns, to_ns) : std::nullopt;
}

void WheelOdometry::update(const FrameResult& result) {
  if (!result.accepted()) return;
  updated_ns_ = result.stamp_ns;
  if (isComparable(result)) {
    if (const auto prior = measure(result.image_motion->from_ns, result.stamp_ns))
      trust_.update(agrees(*prior, *result.image_motion));
  }
  const std::int64_t first_ns = result.stamp_ns - nanoseconds(kWheelsKept_s);
  while (!samples_.empty() && samples_.front().stamp_ns < first_ns) samples_.pop_front();
}

void WheelOdometry::clear() {
  samples_.clear();
  updated_ns_.reset();
}

MotionPrior planarPrior(const PlanarParameters& parameters, const Isometry3d& T_body_camera,
                        std::int64_t from_ns, std::int64_t to_ns) {
  Vector6d deviations;
  deviations << 0.0, 0.0, parameters.z_deviation, parameters.roll_deviation,
      parameters.pitch_deviation, 0.0;
  deviations *= std::sqrt(toSeconds(to_ns - from_ns));
  return ofCamera(priorOfBody(Isometry3d::Identity(), deviations, from_ns, to_ns), T_body_camera);
}

std::optional<MotionPrior> PlanarFloor::between(std::int64_t from_ns, std::int64_t to_ns) const {
  if (!isTrusted()) return std::nullopt;
  return planarPrior(parameters_, T_body_camera_, from_ns, to_ns);
}

void PlanarFloor::update(const FrameResult& result) {
  if (!isComparable(result)) return;
  const MotionPrior prior =
      planarPrior(parameters_, T_body_camera_, result.image_motion->from_ns, result.stamp_ns);
  trust_.update(agrees(prior, *result.image_motion));
}

}  // namespace point_line_odometry
