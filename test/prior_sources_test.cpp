/// Gyroscope, wheels and floor together: the wrong one among them is left out.

#include "priors/prior_sources.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr std::int64_t kFrame_ns = 100'000'000;
constexpr std::int64_t kSample_ns = 5'000'000;
constexpr std::int64_t kBegin_ns = 1'000'000'000;

/// A camera that moves ahead and turns about its y.
const Vector3d kRate(0.0, 0.5, 0.0);

Isometry3d T_odom_camera(std::int64_t ns) {
  const double t = 1e-9 * static_cast<double>(ns - kBegin_ns);
  Isometry3d pose = Isometry3d::Identity();
  pose.linear() = expSO3(t * kRate);
  pose.translation() = Vector3d(-std::cos(0.5 * t), 0.0, std::sin(0.5 * t));
  return pose;
}

Isometry3d motionUntil(std::int64_t ns) {
  return T_odom_camera(ns - kFrame_ns).inverse() * T_odom_camera(ns);
}

class PriorSourcesTest : public ::testing::Test {
 protected:
  PriorSourcesTest() {
    parameters_.imu.enabled = true;
    parameters_.wheels.enabled = true;
  }

  /// The samples until a frame, its prior, and what its images show.
  std::optional<MotionPrior> drive(PriorSources* sources, const Vector3d& rate_of_imu) {
    for (; sampled_ns_ <= now_ns_ + kFrame_ns + kSample_ns; sampled_ns_ += kSample_ns) {
      ImuSample imu;
      imu.stamp_ns = sampled_ns_;
      imu.angular_velocity = rate_of_imu;
      imu.acceleration = acceleration_;
      sources->addImu(imu, Isometry3d::Identity());
      OdometrySample wheels;
      wheels.stamp_ns = sampled_ns_;
      wheels.T_odom_body = T_odom_camera(sampled_ns_);
      sources->addWheels(wheels, Isometry3d::Identity());
    }
    now_ns_ += kFrame_ns;
    const auto prior = sources->takePrior(now_ns_ - kFrame_ns, now_ns_);
    FrameResult result;
    result.stamp_ns = now_ns_;
    result.state = TrackingState::kOk;
    result.twist.setOnes();
    result.image_motion =
        ImageMotion{now_ns_ - kFrame_ns, motionUntil(now_ns_), 1e-8 * Matrix6d::Identity()};
    sources->update(result);
    return prior;
  }

  Parameters parameters_;
  std::int64_t now_ns_ = kBegin_ns;
  std::int64_t sampled_ns_ = kBegin_ns - kFrame_ns;
  Vector3d acceleration_ = Vector3d(0.0, -9.81, 0.0);
};

double errorOf(const MotionPrior& prior) {
  return logSO3(prior.T_prev_curr.linear().transpose() * motionUntil(prior.to_ns).linear()).norm();
}

TEST_F(PriorSourcesTest, TheRightOnesTellTheMotion) {
  PriorSources sources(parameters_);
  sources.setCamera(Isometry3d::Identity());
  for (int k = 0; k < 20; ++k) {
    const auto prior = drive(&sources, kRate);
    ASSERT_TRUE(prior);
    EXPECT_LT(errorOf(*prior), 1e-3);
  }
  EXPECT_EQ(sources.framesWithoutImu(), 0);
  EXPECT_EQ(sources.framesWithoutWheels(), 0);
  EXPECT_TRUE(sources.gyroscope()->isTrusted());
}

/// Axes of the IMU that are wrong in tf: after three frames the wheels go on alone.
TEST_F(PriorSourcesTest, AWrongGyroscopeLeavesTheWheelsInUse) {
  PriorSources sources(parameters_);
  sources.setCamera(Isometry3d::Identity());
  for (int k = 0; k < 3; ++k) drive(&sources, {0.5, 0.0, 0.0});
  EXPECT_FALSE(sources.gyroscope()->isTrusted());
  EXPECT_TRUE(sources.wheels()->isTrusted());
  for (int k = 0; k < 20; ++k) {
    const auto prior = drive(&sources, {0.5, 0.0, 0.0});
    ASSERT_TRUE(prior);
    EXPECT_LT(errorOf(*prior), 1e-3);
  }
}

TEST_F(PriorSourcesTest, AnotherMountingOfTheCameraKeepsWhatIsKnownOfTheImu) {
  PriorSources sources(parameters_);
  sources.setCamera(Isometry3d::Identity());
  const Vector3d bias(0.02, -0.01, 0.03);
  for (int k = 0; k < 30; ++k) drive(&sources, kRate + bias);
  const Vector3d estimated = sources.gyroscope()->calibration().bias;
  EXPECT_LT((estimated - bias).norm(), 5e-3);
  Isometry3d moved = Isometry3d::Identity();
  moved.linear() = expSO3({0.0, 0.0, 0.1});
  sources.setCamera(moved);
  EXPECT_EQ(sources.gyroscope()->calibration().bias, estimated);
  EXPECT_TRUE(sources.hasImuUntil(now_ns_)) << "samples are kept";
}

TEST_F(PriorSourcesTest, GravityIsKeptWhereOdomIs) {
  parameters_.imu.use_gravity = true;
  PriorSources sources(parameters_);
  sources.setCamera(Isometry3d::Identity());
  FrameResult standing;
  standing.state = TrackingState::kOk;
  for (int k = 0; k < 60; ++k) {
    for (; sampled_ns_ <= now_ns_ + kFrame_ns + kSample_ns; sampled_ns_ += kSample_ns) {
      ImuSample imu;
      imu.stamp_ns = sampled_ns_;
      imu.acceleration = acceleration_;
      sources.addImu(imu, Isometry3d::Identity());
    }
    now_ns_ += kFrame_ns;
    standing.stamp_ns = now_ns_;
    standing.image_motion =
        ImageMotion{now_ns_ - kFrame_ns, Isometry3d::Identity(), 1e-8 * Matrix6d::Identity()};
    standing.twist_over_s = 0.1;
    sources.update(standing);
  }
  ASSERT_TRUE(sources.gravity()->calibration().known);
  EXPECT_GT(sources.gravity()->calibration().up.dot(Vector3d(0.0, -1.0, 0.0)), 0.999);
  sources.continueGravity();
  EXPECT_TRUE(sources.gravity()->calibration().known) << "after a gap";
  sources.restartGravity();
  EXPECT_FALSE(sources.gravity()->calibration().known) << "odom has other axes";
}

TEST_F(PriorSourcesTest, SourcesAreSwitchedOnAndOff) {
  PriorSources sources(parameters_);
  EXPECT_TRUE(sources.hasImuUntil(now_ns_)) << "nothing to wait for before the camera is known";
  for (int k = 0; k < 3; ++k) drive(&sources, kRate);
  EXPECT_EQ(sources.gyroscope(), nullptr);
  sources.setCamera(Isometry3d::Identity());
  EXPECT_TRUE(drive(&sources, kRate)) << "samples from before are used";
  Parameters off = parameters_;
  off.imu.enabled = off.wheels.enabled = false;
  sources.setParameters(off);
  EXPECT_FALSE(drive(&sources, kRate));
  EXPECT_EQ(sources.gyroscope(), nullptr);
  EXPECT_EQ(sources.wheels(), nullptr);
  off.planar.enabled = true;
  sources.setParameters(off);
  EXPECT_TRUE(drive(&sources, kRate)) << "by the floor";
  sources.setParameters(parameters_);
  for (int k = 0; k < 3; ++k) drive(&sources, kRate);
  EXPECT_TRUE(drive(&sources, kRate));
  EXPECT_NE(sources.gyroscope(), nullptr);
}

}  // namespace
}  // namespace point_line_odometry
