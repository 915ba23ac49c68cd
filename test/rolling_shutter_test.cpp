#include "geometry/rolling_shutter.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "geometry/se3.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

const StereoCamera kCamera = synthetic::roomCamera();
constexpr double kReadOut_s = 0.03;

RollingShutter shutterAt(const Vector3d& linear, const Vector3d& angular) {
  Vector6d velocity;
  velocity << linear, angular;
  return {kReadOut_s, velocity, Vector6d::Zero(), true};
}

PixelWithDisparity project(const Vector3d& p) {
  const Vector2d left_px = kCamera.projectLeft(p);
  return {left_px, left_px.x() - kCamera.projectRight(p).x()};
}

TEST(RollingShutter, AGlobalOneChangesNothing) {
  const RollingShutter global;
  EXPECT_TRUE(global.isGlobal());
  const PixelWithDisparity seen{{12.5, 400.25}, 7.5};
  EXPECT_EQ(global.atStamp(kCamera, seen).left_px, seen.left_px);
  EXPECT_EQ(global.atStamp(kCamera, seen).disparity_px, seen.disparity_px);
  EXPECT_EQ(global.whenExposed(kCamera, {1.0, 2.0, 5.0}), Vector3d(1.0, 2.0, 5.0));
}

TEST(RollingShutter, TheMiddleRowIsAtTheStamp) {
  const RollingShutter shutter = shutterAt({1.0, 0.0, 0.0}, {0.0, 0.0, 0.0});
  EXPECT_DOUBLE_EQ(shutter.timeOf(kCamera, -0.5), -0.5 * kReadOut_s);
  EXPECT_NEAR(shutter.timeOf(kCamera, 0.5 * kCamera.height - 0.5), 0.0, 1e-15);
  EXPECT_DOUBLE_EQ(shutter.timeOf(kCamera, kCamera.height - 0.5), 0.5 * kReadOut_s);
  EXPECT_DOUBLE_EQ(shutter.timeOf(kCamera, 10.0 * kCamera.height), 0.5 * kReadOut_s);
}

/// Rectification enlarges the images of most lenses.
TEST(RollingShutter, RowsOfTheRawImageHaveTheTime) {
  const RollingShutter shutter = shutterAt({1.0, 0.0, 0.0}, {0.0, 0.0, 0.0});
  StereoCamera enlarged = kCamera;
  enlarged.raw_rows = 0.8;
  EXPECT_DOUBLE_EQ(shutter.timeOf(enlarged, -0.5), -0.4 * kReadOut_s);
  EXPECT_NE(enlarged, kCamera);
}

/// The camera moves to the right, and so what it sees to the left: at the stamp, before, a point in
/// a lower row was further right.
TEST(RollingShutter, ALowerRowIsSeenLater) {
  const RollingShutter shutter = shutterAt({2.0, 0.0, 0.0}, Vector3d::Zero());
  const Vector3d p(0.3, 0.8, 4.0);
  const PixelWithDisparity seen = project(p);
  ASSERT_GT(seen.left_px.y(), 0.5 * kCamera.height);
  const double later_s = shutter.timeOf(kCamera, seen.left_px.y());
  const PixelWithDisparity at_stamp = shutter.atStamp(kCamera, seen);
  EXPECT_NEAR(at_stamp.left_px.x() - seen.left_px.x(), kCamera.fx * 2.0 * later_s / 4.0, 1e-9);
  EXPECT_NEAR(at_stamp.left_px.y(), seen.left_px.y(), 1e-9);
  EXPECT_NEAR(at_stamp.disparity_px, seen.disparity_px, 1e-9);
}

TEST(RollingShutter, MovesPixelsAsTheCameraMoves) {
  synthetic::Random random(3);
  for (int i = 0; i < 200; ++i) {
    const Vector3d linear = random.uniform<3>({-5.0, -1.0, -5.0}, {5.0, 1.0, 15.0});
    const Vector3d angular = random.uniform<3>({-2.0, -2.0, -2.0}, {2.0, 2.0, 2.0});
    const RollingShutter shutter = shutterAt(linear, angular);
    const Vector3d p_stamp = synthetic::visiblePoint(kCamera, &random);
    const Vector3d p_exposed = shutter.whenExposed(kCamera, p_stamp);
    const PixelWithDisparity seen = project(p_exposed);
    const double t = shutter.timeOf(kCamera, seen.left_px.y());
    EXPECT_LT((expSO3(t * angular) * p_exposed + t * linear - p_stamp).norm(), 1e-3) << i;
    const PixelWithDisparity at_stamp = shutter.atStamp(kCamera, seen);
    EXPECT_LT((at_stamp.left_px - project(p_stamp).left_px).norm(), 0.02) << i;
    EXPECT_NEAR(at_stamp.disparity_px, project(p_stamp).disparity_px, 0.005) << i;
  }
}

/// Where a disparity is not positive, the rotation is known nevertheless.
TEST(RollingShutter, PointsWithoutDepthTurn) {
  const RollingShutter turning = shutterAt({3.0, 0.0, 0.0}, {0.0, 1.0, 0.0});
  const Vector2d pixel(kCamera.cx, kCamera.height - 20.5);
  const double t = turning.timeOf(kCamera, pixel.y());
  const PixelWithDisparity at_stamp = turning.atStamp(kCamera, {pixel, 0.0});
  EXPECT_NEAR(at_stamp.left_px.x() - pixel.x(), kCamera.fx * std::tan(t), 1e-6);
  EXPECT_EQ(at_stamp.disparity_px, 0.0);
  const PixelWithDisparity negative = turning.atStamp(kCamera, {pixel, -0.5});
  EXPECT_TRUE(negative.left_px.allFinite());
  EXPECT_LT(negative.left_px.x(), at_stamp.left_px.x());
}

/// A velocity that would carry the camera through a point says nothing of its pixel.
TEST(RollingShutter, APointThatIsReachedStays) {
  const RollingShutter fast = shutterAt({0.0, 0.0, 500.0}, Vector3d::Zero());
  const Vector3d near(0.2, 1.0, 2.0);
  EXPECT_EQ(fast.whenExposed(kCamera, near), near);
  const PixelWithDisparity above{{300.0, 5.0}, 60.0};
  EXPECT_EQ(fast.atStamp(kCamera, above).left_px, above.left_px);
}

}  // namespace
}  // namespace point_line_odometry
