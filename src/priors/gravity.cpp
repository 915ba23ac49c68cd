#include "point_line_odometry/gravity.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "geometry/se3.h"
#include "odometry/tilt.h"

namespace point_line_odometry {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kGravity = 9.81;  // [m/s^2]
constexpr double kWindow_s = 2.0;  // of a measurement
constexpr std::size_t kMaxFrames = 2000;

// The length of a measurement may differ so much from gravity: bias and scale of the accelerometer.
constexpr double kMaxBias = 0.5;  // [m/s^2]

// A measurement that is less certain says nothing.
constexpr double kMaxDeviation = 0.5;  // [m/s^2]

// Before anything was estimated: a micro-mechanical accelerometer that nobody has calibrated.
constexpr double kFirstBias_m_s2 = 0.2;  // [m/s^2], each axis
constexpr double kFirstTilt = 1.0;       // [rad], of the direction

// Errors of a measurement.
constexpr double kFloor = 0.01;          // [m/s^2], that of extrinsics, temperature
constexpr double kShareOfMotion = 0.01;  // of the acceleration of the motion: scales, time offset
constexpr double kShareOfSpread = 0.02;  // of vibrations: rectified, aliased

// Largest squared Mahalanobis distance of a measurement: 99.9 % of chi-square, 3 degrees of
// freedom. After N in a row beyond it, it is the expectation that is wrong.
constexpr double kMaxGravityDistance = 16.27;
constexpr int kMaxRejected = 5;

/// Nearest symmetric matrix without negative eigenvalues.
Matrix3d positive(const Matrix3d& m) {
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(0.5 * (m + m.transpose()));
  return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).asDiagonal() *
         eigen.eigenvectors().transpose();
}

}  // namespace

Gravity::Gravity(const ImuParameters& parameters, const Eigen::Isometry3d& T_camera_imu)
    : parameters_(parameters), T_camera_imu_(T_camera_imu) {}

void Gravity::restart() {
  window_.clear();
  known_ = false;
  rejected_in_a_row_ = 0;
  correction_.reset();
}

void Gravity::continueAfterGap(const Eigen::Isometry3d& T_camera_imu) {
  T_camera_imu_ = T_camera_imu;
  window_.clear();
  correction_.reset();
}

void Gravity::update(const FrameResult& result, const Gyroscope& gyroscope) {
  if (!result.accepted()) return;
  correction_.reset();  // of an earlier pose
  addFrame(result, gyroscope);
  if (window_.size() < 3) return;
  const std::int64_t end_ns = window_.back().stamp_ns;
  if (toSeconds(end_ns - window_.front().stamp_ns) < kWindow_s) return;
  const std::optional<Measurement> measurement = measure();
  if (measurement) {
    update(*measurement, result.estimate_covariance);
  } else {
    ++windows_.not_gravity;
  }
  window_.erase(window_.begin(), window_.end() - 1);
  if (correction_)
    window_.back().T_odom_camera.linear() =
        expSO3(correction_->rotation) * window_.back().T_odom_camera.linear();
}

/// A window has only frames whose motion the images gave, one after the other and without a gap.
void Gravity::addFrame(const FrameResult& result, const Gyroscope& gyroscope) {
  const bool measured = result.state == TrackingState::kOk && result.image_motion &&
                        result.twist_over_s > 0.0 && result.counts.relocalizations == 0;
  Frame frame;
  frame.stamp_ns = result.stamp_ns;
  frame.T_odom_camera = result.T_odom_estimate;
  frame.by_landmarks = result.by_landmarks;
  if (!measured || window_.size() >= kMaxFrames) {
    window_.clear();
  } else if (!window_.empty()) {
    const std::int64_t last_ns = window_.back().stamp_ns;
    const auto force = gyroscope.forceBetween(last_ns, frame.stamp_ns);
    if (force && result.image_motion->from_ns == last_ns) {
      frame.force = *force;
      const Matrix3d velocity = result.twist_covariance.topLeftCorner<3, 3>();
      frame.step_variance = velocity.trace() / 3.0 * std::pow(result.twist_over_s, 2);
      if (window_.back().by_landmarks) window_.back().step_variance = 0.0;  // not propagated
    } else {
      window_.clear();
    }
  }
  window_.push_back(frame);
}

/// With positions p at three times t the mean acceleration under a triangular weight w of area 1,
/// whose peak is at t1, is the second divided difference 2 / (t2 - t0) ((p2 - p1) / (t2 - t1) -
/// (p1 - p0) / (t1 - t0)): the mean specific force under the same weight less this is gravity,
/// whatever the motion was.
std::optional<Gravity::Measurement> Gravity::measure() const {
  const Frame& first = window_.front();
  const Frame& last = window_.back();
  const double middle_s = 0.5 * toSeconds(last.stamp_ns - first.stamp_ns);
  std::size_t middle = 1;
  while (middle + 2 < window_.size() &&
         toSeconds(window_[middle].stamp_ns - first.stamp_ns) < middle_s)
    ++middle;
  const double rise_s = toSeconds(window_[middle].stamp_ns - first.stamp_ns);
  const double fall_s = toSeconds(last.stamp_ns - window_[middle].stamp_ns);
  const double peak = 2.0 / (rise_s + fall_s);
  Measurement measurement;
  measurement.J_bias.setZero();
  Vector3d mean = Vector3d::Zero();
  double squares = 0.0;
  double rise_variance = 0.0;
  double fall_variance = 0.0;
  for (std::size_t i = 1; i < window_.size(); ++i) {
    const bool rises = i <= middle;
    const Frame& before = window_[i - 1];
    const SpecificForce& force = window_[i].force;
    const double weight = rises ? peak / rise_s * toSeconds(before.stamp_ns - first.stamp_ns)
                                : peak / fall_s * toSeconds(last.stamp_ns - before.stamp_ns);
    const double slope = rises ? peak / rise_s : -peak / fall_s;
    const Matrix3d R = before.T_odom_camera.linear();
    measurement.force += R * (weight * force.sum + slope * force.moment);
    measurement.J_bias += R * (weight * force.rotation_sum + slope * force.rotation_moment);
    mean += R * force.sum / (rise_s + fall_s);
    squares += force.squares / (rise_s + fall_s);
    (rises ? rise_variance : fall_variance) += window_[i].step_variance;
  }
  const auto position = [&](const Frame& frame) -> Vector3d {
    return frame.T_odom_camera * T_camera_imu_.translation();
  };
  const Vector3d now = position(window_[middle]);
  const Vector3d acceleration =
      peak * ((position(last) - now) / fall_s - (now - position(first)) / rise_s);
  measurement.force -= acceleration;
  const double spread = std::max(0.0, squares - mean.squaredNorm());
  measurement.variance =
      kFloor * kFloor + std::pow(kShareOfMotion, 2) * acceleration.squaredNorm() +
      std::pow(kShareOfSpread, 2) * spread +
      peak * peak * (rise_variance / (rise_s * rise_s) + fall_variance / (fall_s * fall_s)) +
      std::pow(parameters_.accelerometer_noise, 2) * 4.0 / (3.0 * (rise_s + fall_s));
  const double deviation = std::sqrt(measurement.variance);
  const double length = (measurement.force - measurement.J_bias * bias_).norm();
  const bool is_gravity =
      deviation <= kMaxDeviation && std::abs(length - kGravity) <= kMaxBias + 3.0 * deviation;
  return is_gravity ? std::make_optional(measurement) : std::nullopt;
}

/// force = gravity up - gravity up x (e_up - e_pose) + J e_bias, with the errors e.
void Gravity::update(const Measurement& measurement, const Matrix6d& pose_covariance) {
  const Matrix3d rotation_covariance = pose_covariance.bottomRightCorner<3, 3>();
  if (!known_) start(measurement);
  grow(rotation_covariance);
  updated_ns_ = window_.back().stamp_ns;
  Eigen::Matrix<double, 3, 9> H;
  H << kGravity * skew(up_), -kGravity * skew(up_), measurement.J_bias;
  const Vector3d innovation = measurement.force - kGravity * up_ - measurement.J_bias * bias_;
  const Matrix3d N = measurement.variance * Matrix3d::Identity();
  const Eigen::LDLT<Matrix3d> root(H * covariance_ * H.transpose() + N);
  const double distance = innovation.dot(root.solve(innovation));
  if (!(distance <= kMaxGravityDistance)) {
    ++windows_.rejected;
    if (++rejected_in_a_row_ >= kMaxRejected) {
      ++windows_.restarts;
      rejected_in_a_row_ = 0;
      known_ = false;
    }
    return;
  }
  rejected_in_a_row_ = 0;
  ++windows_.used;
  Eigen::Matrix<double, 9, 3> gain = root.solve(H * covariance_).transpose();
  // Nothing turns about the vertical.
  const Matrix3d horizontal = Matrix3d::Identity() - up_ * up_.transpose();
  gain.topRows<3>() = horizontal * gain.topRows<3>();
  gain.middleRows<3>(3) = horizontal * gain.middleRows<3>(3);
  const Eigen::Matrix<double, 9, 1> error = gain * innovation;
  // Joseph's form, which is right for a gain that is not the optimal one, too.
  const Matrix9d left = Matrix9d::Identity() - gain * H;
  covariance_ = left * covariance_ * left.transpose() + gain * N * gain.transpose();
  covariance_ = 0.5 * (covariance_ + covariance_.transpose()).eval();
  bias_ += error.tail<3>();
  TiltCorrection correction;
  correction.rotation = error.head<3>();
  up_ = (expSO3(error.segment<3>(3)) * up_).normalized();
  correction.up = up_;
  correction.rotation -= up_ * up_.dot(correction.rotation);
  const Matrix3d across = Matrix3d::Identity() - up_ * up_.transpose();
  correction.covariance = across * covariance_.topLeftCorner<3, 3>() * across;
  Matrix6d corrected = pose_covariance;
  if (isUsable(correction)) {
    corrected = correctedCovariance(pose_covariance, correction);
    correction_ = correction;
  }
  pose_covariance_ = corrected.bottomRightCorner<3, 3>();
}

/// The direction as measured; its errors are those of the pose, of the bias and of the measurement.
void Gravity::start(const Measurement& measurement) {
  known_ = true;
  up_ = measurement.force.normalized();
  bias_.setZero();
  covariance_.setZero();
  covariance_.diagonal().segment<3>(3).setConstant(kFirstTilt * kFirstTilt);
  covariance_.diagonal().tail<3>().setConstant(kFirstBias_m_s2 * kFirstBias_m_s2);
  pose_covariance_.setZero();
  updated_ns_ = window_.back().stamp_ns;
}

/// The errors since the last update: of the pose by its covariance, of the bias by its random walk.
void Gravity::grow(const Matrix3d& rotation_covariance) {
  covariance_.topLeftCorner<3, 3>() += positive(rotation_covariance - pose_covariance_);
  pose_covariance_ = rotation_covariance;
  const double since_s = toSeconds(window_.back().stamp_ns - updated_ns_);
  const double walk = std::pow(parameters_.accelerometer_random_walk, 2) * std::max(since_s, 0.0);
  covariance_.diagonal().tail<3>().array() += walk;
}

std::optional<TiltCorrection> Gravity::takeCorrection() {
  std::optional<TiltCorrection> taken;
  taken.swap(correction_);
  return taken;
}

GravityCalibration Gravity::calibration() const {
  GravityCalibration calibration;
  calibration.known = known_;
  calibration.up = up_;
  calibration.bias = bias_;
  calibration.bias_sigma = covariance_.diagonal().tail<3>().cwiseSqrt();
  calibration.windows = windows_;
  return calibration;
}

}  // namespace point_line_odometry
