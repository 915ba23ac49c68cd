/// The IMU of the built-in world, its lights, and what the gyroscope brings where they are out.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "geometry/se3.h"
#include "point_line_odometry/gyroscope.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/stereo_odometry.h"
#include "world/synthetic_world.h"

namespace point_line_odometry {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

SyntheticWorldOptions indoor(int seed) {
  SyntheticWorldOptions options;
  options.scene = "indoor";
  options.seed = seed;
  return options;
}

TEST(WorldImu, GivesTheRotationOfTheCamera) {
  for (const char* scene : {"street", "indoor"}) {
    SyntheticWorldOptions options = indoor(3);
    options.scene = scene;
    options.imu_offset_ms = 12.0;
    const SyntheticWorld world(options);
    const ImuData imu = world.imu(100);
    ASSERT_GT(imu.samples.size(), 200U * 5);
    EXPECT_EQ(imu.samples[1].stamp_ns - imu.samples[0].stamp_ns, 5000000);
    ImuParameters parameters;
    parameters.time_offset_s = 0.012;
    parameters.estimate_time_offset = false;
    Gyroscope gyroscope(parameters, imu.T_imu_camera.linear().transpose());
    Vector3d gravity = Vector3d::Zero();
    for (const ImuSample& sample : imu.samples) {
      gyroscope.add(sample);
      gravity += sample.acceleration / static_cast<double>(imu.samples.size());
    }
    EXPECT_NEAR(gravity.norm(), 9.81, 0.5) << scene;
    const StampedPose from = world.pose(40);
    const StampedPose to = world.pose(42);
    const auto prior = gyroscope.between(from.stamp_ns, to.stamp_ns);
    ASSERT_TRUE(prior);
    const Matrix3d R = from.T_world_camera.linear().transpose() * to.T_world_camera.linear();
    const double dt_s = 1e-9 * static_cast<double>(to.stamp_ns - from.stamp_ns);
    // The bias is not known to this gyroscope.
    EXPECT_LT(rotationAngle(prior->T_prev_curr.linear() * R.transpose()), 0.06 * dt_s) << scene;
  }
}

TEST(WorldImu, IsTheSameForTheSameSeed) {
  const ImuData a = SyntheticWorld(indoor(3)).imu(20);
  const ImuData b = SyntheticWorld(indoor(3)).imu(40);
  const ImuData other = SyntheticWorld(indoor(4)).imu(20);
  ASSERT_LT(a.samples.size(), b.samples.size());
  for (std::size_t i = 0; i < a.samples.size(); ++i) {
    EXPECT_EQ(a.samples[i].stamp_ns, b.samples[i].stamp_ns);
    EXPECT_EQ(a.samples[i].angular_velocity, b.samples[i].angular_velocity);
    EXPECT_EQ(a.samples[i].acceleration, b.samples[i].acceleration);
  }
  EXPECT_NE(a.samples[9].angular_velocity, other.samples[9].angular_velocity);
}

TEST(WorldLights, GoOutAndComeBack) {
  SyntheticWorldOptions options = indoor(3);
  const SyntheticWorld bright(options);
  options.lights_out_at_s = 0.1;
  options.lights_out_s = 0.1;
  const SyntheticWorld world(options);
  const auto brightness = [&](std::size_t frame) { return cv::mean(world.render(frame).left)[0]; };
  EXPECT_GT(brightness(1), 30.0);
  EXPECT_LT(brightness(2), 5.0);
  EXPECT_LT(brightness(3), 5.0);
  EXPECT_EQ(cv::norm(world.render(4).left, bright.render(4).left, cv::NORM_INF), 0.0);
}

/// The largest error of the position [m], and that of the rotation at the end [rad].
struct Errors {
  double position_m = 0.0;
  double rotation_rad = 0.0;

  void add(const FrameResult& result, const Eigen::Isometry3d& ground_truth) {
    position_m = std::max(position_m,
                          (result.T_odom_camera.translation() - ground_truth.translation()).norm());
    rotation_rad = rotationAngle(result.T_odom_camera.linear().transpose() * ground_truth.linear());
  }
};

/// 1.5 s without light, in a turn.
TEST(WorldLights, GyroscopeCarriesThePoseThroughTheDark) {
  SyntheticWorldOptions options = indoor(11);
  options.lights_out_at_s = 8.0;
  options.lights_out_s = 1.5;
  constexpr std::size_t kFirst = 120;
  constexpr std::size_t kEnd = 200;
  const SyntheticWorld world(options);
  const StereoRectifier rectifier(world.calibration());
  Eigen::Isometry3d T_rectified_raw = Eigen::Isometry3d::Identity();
  T_rectified_raw.linear() = rectifier.R_rectified_raw();
  const ImuData imu = world.imu(kEnd);
  Gyroscope gyroscope({}, T_rectified_raw.linear() * imu.T_imu_camera.linear().transpose());
  for (const ImuSample& sample : imu.samples) gyroscope.add(sample);
  StereoOdometry with(rectifier.camera(), {});
  StereoOdometry without(rectifier.camera(), {});
  Errors errors_with;
  Errors errors_without;
  std::optional<std::int64_t> last_ns;
  for (std::size_t k = kFirst; k < kEnd; ++k) {
    const StereoImages images = rectifier.rectify(world.render(k));
    std::optional<MotionPrior> prior;
    if (last_ns) prior = gyroscope.between(*last_ns, images.stamp_ns);
    const FrameResult result = with.process(images, prior ? &*prior : nullptr);
    gyroscope.update(result);
    last_ns = images.stamp_ns;
    const Eigen::Isometry3d ground_truth = T_rectified_raw *
                                           world.pose(kFirst).T_world_camera.inverse() *
                                           world.pose(k).T_world_camera * T_rectified_raw.inverse();
    errors_with.add(result, ground_truth);
    errors_without.add(without.process(images), ground_truth);
  }
  EXPECT_LT(errors_with.rotation_rad, 0.02);
  EXPECT_GT(errors_without.rotation_rad, 5.0 * errors_with.rotation_rad);
  EXPECT_LT(errors_with.position_m, 0.5 * errors_without.position_m);
}

}  // namespace
}  // namespace point_line_odometry
