/// Roll and pitch by gravity: the filter on made-up motions, and the correction of the odometry's
/// pose.

#include "point_line_odometry/gravity.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "geometry/se3.h"
#include "odometry/odometry_pose.h"
#include "odometry/tilt.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr std::int64_t kSecond = 1000000000;
constexpr std::int64_t kFrame = kSecond / 20;
constexpr std::int64_t kSample = kSecond / 200;
constexpr double kDegree = M_PI / 180.0;

double seconds(std::int64_t ns) { return 1e-9 * static_cast<double>(ns); }

/// A flight, an odometry whose roll and pitch drift, and an IMU on the camera.
struct Flight {
  double end_s = 120.0;
  std::function<Isometry3d(double)> T_world_camera = [](double) { return Isometry3d::Identity(); };
  Vector3d drift_rad_s = {0.04 * kDegree, 0.0, -0.03 * kDegree};  ///< about the axes of odom
  Vector3d bias = Vector3d::Zero();                               ///< of the accelerometer
  std::function<void(double t, ImuSample*)> disturb = [](double, ImuSample*) {};
  Isometry3d T_camera_imu = Isometry3d::Identity();
  Matrix3d R_given_imu = Matrix3d::Identity();  ///< the axes in tf, less the true ones
  double gravity = 9.81;
};

/// Walks about with turns and bobbing, y down.
Isometry3d walking(double t) {
  Isometry3d T = Isometry3d::Identity();
  T.linear() = expSO3({0.0, 0.3 * t, 0.0}) * expSO3({0.05 * std::sin(2.0 * t), 0.0, 0.0});
  T.translation() << 2.0 * std::sin(0.4 * t), 0.05 * std::sin(8.0 * t), 1.5 * std::cos(0.3 * t);
  return T;
}

struct Outcome {
  double tilt_rad = 0.0;     ///< error of roll and pitch at the end
  double largest_rad = 0.0;  ///< of the second half
  double yaw_rad = 0.0;      ///< the turn by corrections about the vertical
  int corrections = 0;
  GravityCalibration calibration;
  Matrix3d covariance = Matrix3d::Zero();
};

ImuSample sampleAt(const Flight& flight, double t) {
  constexpr double kStep = 1e-3;
  const auto pose = [&](double at) { return flight.T_world_camera(at) * flight.T_camera_imu; };
  const Isometry3d before = pose(t - kStep);
  const Isometry3d now = pose(t);
  const Isometry3d after = pose(t + kStep);
  ImuSample sample;
  sample.stamp_ns = 100 * kSecond + std::llround(1e9 * t);
  sample.angular_velocity = logSO3(before.linear().transpose() * after.linear()) / (2.0 * kStep);
  const Vector3d acceleration =
      (after.translation() - 2.0 * now.translation() + before.translation()) / (kStep * kStep);
  sample.acceleration =
      now.linear().transpose() * (acceleration + flight.gravity * Vector3d(0.0, -1.0, 0.0)) +
      flight.bias;
  flight.disturb(t, &sample);
  return sample;
}

/// The odometry's positions are the true ones; its rotation drifts, and takes corrections.
Outcome fly(const Flight& flight) {
  ImuParameters parameters;
  parameters.enabled = true;
  parameters.estimate_time_offset = false;
  Isometry3d T_given = flight.T_camera_imu;
  T_given.linear() = T_given.linear() * flight.R_given_imu;
  Gyroscope gyroscope(parameters, T_given.linear());
  Gravity gravity(parameters, T_given);
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  Outcome outcome;
  Matrix3d R_drift = Matrix3d::Identity();
  double variance = 0.0;
  double sample_s = -1.0;
  std::optional<std::int64_t> last_ns;
  for (int k = 0; seconds(k * kFrame) < flight.end_s; ++k) {
    const double t = seconds(k * kFrame);
    for (; sample_s <= t + 0.05; sample_s += seconds(kSample)) {
      ImuSample sample = sampleAt(flight, sample_s);
      for (int i = 0; i < 3; ++i) sample.acceleration[i] += 0.03 * normal(random);
      gyroscope.add(sample);
    }
    if (const auto correction = gravity.takeCorrection()) {
      EXPECT_TRUE(isUsable(*correction));
      R_drift = expSO3(correction->rotation) * R_drift;
      outcome.yaw_rad += correction->rotation.dot(correction->up);
      outcome.covariance = correction->covariance;
      const double kept = correction->covariance.trace() / 2.0;
      variance = std::min(variance, kept);
      ++outcome.corrections;
    }
    const double dt = seconds(kFrame);
    R_drift = expSO3(dt * flight.drift_rad_s) * R_drift;
    variance += std::pow(0.07 * kDegree, 2) * dt;
    FrameResult result;
    result.stamp_ns = 100 * kSecond + k * kFrame;
    result.state = k == 0 ? TrackingState::kInitializing : TrackingState::kOk;
    result.reason = k == 0 ? TrackingReason::kFirstFrame : TrackingReason::kNone;
    result.T_odom_estimate = flight.T_world_camera(t);
    result.T_odom_estimate.linear() = R_drift * result.T_odom_estimate.linear();
    for (int i = 0; i < 3; ++i) result.T_odom_estimate.translation()[i] += 0.001 * normal(random);
    result.estimate_covariance.bottomRightCorner<3, 3>() = variance * Matrix3d::Identity();
    result.twist.setOnes();
    result.twist_over_s = dt;
    result.twist_covariance.diagonal().setConstant(std::pow(0.002 / dt, 2));
    if (last_ns) {
      ImageMotion motion;
      motion.from_ns = *last_ns;
      motion.T_prev_curr = flight.T_world_camera(t - dt).inverse() * flight.T_world_camera(t);
      motion.covariance.diagonal().setConstant(1e-6);
      result.image_motion = motion;
    }
    last_ns = result.stamp_ns;
    gyroscope.update(result);
    gravity.update(result, gyroscope);
    const Vector3d down = R_drift * Vector3d::UnitY();
    outcome.tilt_rad = std::acos(std::clamp(down.y(), -1.0, 1.0));
    if (t > 0.5 * flight.end_s)
      outcome.largest_rad = std::max(outcome.largest_rad, outcome.tilt_rad);
  }
  outcome.calibration = gravity.calibration();
  return outcome;
}

TEST(Gravity, KeepsRollAndPitchAtRestAndInMotion) {
  for (const bool moves : {false, true}) {
    Flight flight;
    if (moves) flight.T_world_camera = walking;
    flight.T_camera_imu.translation() << 0.1, -0.05, 0.2;
    flight.T_camera_imu.linear() = expSO3({0.4, -1.0, 0.2});
    const Outcome outcome = fly(flight);
    // Without it 0.05 deg/s are 6 deg. A part of a drift that never changes is taken for bias.
    EXPECT_LT(outcome.largest_rad, 1.0 * kDegree) << moves;
    EXPECT_GT(outcome.corrections, 20) << moves;
    EXPECT_NEAR(outcome.yaw_rad, 0.0, 1e-6) << moves;
    EXPECT_GT(Eigen::Vector3d(-outcome.calibration.up).dot(Vector3d::UnitY()), 0.9999);
  }
}

TEST(Gravity, BiasIsTold) {
  Flight flight;
  flight.T_world_camera = walking;
  flight.bias << 0.15, -0.1, 0.12;
  flight.end_s = 240.0;
  const Outcome outcome = fly(flight);
  EXPECT_LT(outcome.largest_rad, 1.0 * kDegree);
  const Vector3d error = outcome.calibration.bias - flight.bias;
  for (int i = 0; i < 3; ++i)
    EXPECT_LT(std::abs(error[i]), 4.0 * outcome.calibration.bias_sigma[i] + 0.02) << i;
}

TEST(Gravity, ACurveAtConstantAccelerationIsNotTiltedBy) {
  Flight flight;
  flight.drift_rad_s.setZero();
  flight.T_world_camera = [](double t) {
    Isometry3d T = Isometry3d::Identity();
    T.linear() = expSO3({0.0, 0.5 * t, 0.0});
    T.translation() << 12.0 * std::sin(0.5 * t), 0.0, 12.0 * std::cos(0.5 * t);  // 3 m/s^2
    return T;
  };
  const Outcome outcome = fly(flight);
  EXPECT_LT(outcome.largest_rad, 0.3 * kDegree);  // by 17 degrees, if that were taken for gravity
  EXPECT_GT(outcome.corrections, 20);
}

TEST(Gravity, FreeFallAndWrongLengthsAreNotUsed) {
  const auto scaled = [](double factor) {
    Flight flight;
    flight.drift_rad_s.setZero();
    flight.disturb = [factor](double, ImuSample* sample) { sample->acceleration *= factor; };
    return fly(flight);
  };
  for (const double factor : {0.0, 0.5, 2.0}) {  // in g, an accelerometer would measure 1
    const Outcome outcome = scaled(factor);
    EXPECT_EQ(outcome.corrections, 0) << factor;
    EXPECT_GT(outcome.calibration.windows.not_gravity, 10U);
    EXPECT_FALSE(outcome.calibration.known);
  }
  // Falls between the 30th and the 33rd second.
  Flight falling;
  falling.disturb = [](double t, ImuSample* sample) {
    if (t > 30.0 && t < 33.0) sample->acceleration *= 0.01;
  };
  const Outcome outcome = fly(falling);
  EXPECT_GT(outcome.calibration.windows.not_gravity, 0U);
  EXPECT_LT(outcome.tilt_rad, 1.0 * kDegree);
}

TEST(Gravity, VibrationIsAveragedOut) {
  Flight flight;
  flight.T_world_camera = walking;
  flight.disturb = [](double t, ImuSample* sample) {
    sample->acceleration += 6.0 * std::sin(2.0 * M_PI * 83.0 * t) * Vector3d(1.0, 0.7, -0.5);
  };
  EXPECT_LT(fly(flight).largest_rad, 1.5 * kDegree);
}

TEST(Gravity, UpsideDownIsAsGood) {
  Flight flight;
  flight.T_world_camera = walking;
  flight.T_camera_imu.linear() = expSO3({0.0, 0.0, M_PI});
  EXPECT_LT(fly(flight).largest_rad, 1.0 * kDegree);
  // A camera that hangs from the ceiling: odom's axes are those of its first pose.
  Flight hanging;
  hanging.drift_rad_s = {0.04 * kDegree, 0.0, 0.0};
  hanging.gravity = -9.81;
  const Outcome outcome = fly(hanging);
  EXPECT_LT(outcome.largest_rad, 1.0 * kDegree);
  EXPECT_GT(outcome.calibration.up.y(), 0.999);
}

TEST(Gravity, NumbersThatAreNoneDoNoHarm) {
  Flight flight;
  int count = 0;
  flight.disturb = [&count](double, ImuSample* sample) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const double infinite = std::numeric_limits<double>::infinity();
    if (++count % 7 == 0) sample->acceleration.x() = nan;
    if (count % 11 == 0) sample->acceleration.z() = infinite;
    if (count % 500 == 0) sample->acceleration.setConstant(1e300);
  };
  const Outcome outcome = fly(flight);
  EXPECT_TRUE(std::isfinite(outcome.tilt_rad));
  EXPECT_TRUE(outcome.calibration.up.allFinite());
  EXPECT_TRUE(outcome.calibration.bias.allFinite());
}

/// In a turn the direction contradicts itself: it is rejected, not followed.
TEST(Gravity, WrongAxesDoLittleHarm) {
  Flight flight;
  flight.drift_rad_s.setZero();
  flight.T_world_camera = walking;
  flight.R_given_imu = expSO3({M_PI / 2.0, 0.0, 0.0});
  const Outcome outcome = fly(flight);
  EXPECT_LT(outcome.largest_rad, 6.0 * kDegree);
  EXPECT_GT(outcome.calibration.windows.rejected + outcome.calibration.windows.not_gravity, 5U);
}

// --- The correction of the pose

Matrix6d someCovariance() {
  Matrix6d root = Matrix6d::Random();
  return 0.01 * root * root.transpose() + 1e-4 * Matrix6d::Identity();
}

TEST(Tilt, ReducesThatOfTheTiltOnly) {
  const Matrix6d before = someCovariance();
  TiltCorrection correction;
  correction.up = Vector3d(0.1, -1.0, 0.2).normalized();
  const Matrix3d across = Matrix3d::Identity() - correction.up * correction.up.transpose();
  correction.covariance = 1e-6 * across;
  const Matrix6d after = correctedCovariance(before, correction);
  EXPECT_NEAR((across * after.bottomRightCorner<3, 3>() * across).trace(), 2e-6, 1e-9);
  EXPECT_TRUE((after.topLeftCorner<3, 3>()).isApprox(before.topLeftCorner<3, 3>(), 1e-12));
  const auto yaw = [&](const Matrix6d& m) {
    return correction.up.dot(m.bottomRightCorner<3, 3>() * correction.up);
  };
  EXPECT_NEAR(yaw(after), yaw(before), 1e-12);
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(after);
  EXPECT_GT(eigen.eigenvalues().minCoeff(), 0.0);
  correction.covariance = 10.0 * across;
  EXPECT_TRUE(correctedCovariance(before, correction).isApprox(before, 1e-9)) << "never grows";
}

TEST(Tilt, UnusableOnesAreTold) {
  TiltCorrection correction;
  EXPECT_TRUE(isUsable(correction));
  correction.rotation.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(isUsable(correction));
  correction.rotation.setZero();
  correction.up.setZero();
  EXPECT_FALSE(isUsable(correction));
}

/// The estimate is turned at once, in place; what is published does not jump.
TEST(Tilt, ThePublishedPoseFollowsGradually) {
  Isometry3d start = Isometry3d::Identity();
  start.translation() << 3.0, 2.0, 1.0;
  OdometryPose pose(start);
  TiltCorrection correction;
  correction.up = -Vector3d::UnitY();
  correction.rotation << 0.02, 0.0, 0.0;
  pose.correctTilt(correction);
  FrameResult result;
  pose.report(TrackingState::kOk, {}, &result);
  EXPECT_TRUE(result.T_odom_camera.isApprox(start, 1e-12));
  EXPECT_TRUE(result.T_odom_estimate.translation().isApprox(start.translation(), 1e-12));
  EXPECT_TRUE(result.T_odom_estimate.linear().isApprox(expSO3(correction.rotation), 1e-12));
  double last = 0.02;
  for (int k = 1; k <= 60; ++k) {
    pose.predict(seconds(kFrame), {}, nullptr);
    pose.report(TrackingState::kDegraded, {}, &result);
    const double left =
        rotationAngle(result.T_odom_camera.linear().transpose() * result.T_odom_estimate.linear());
    EXPECT_LE(left, last + 1e-12);
    EXPECT_LT(last - left, 0.006) << "in a frame";
    last = left;
  }
  EXPECT_LT(last, 1e-3);
}

}  // namespace
}  // namespace point_line_odometry
