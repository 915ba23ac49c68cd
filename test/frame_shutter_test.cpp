#include "odometry/frame_shutter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "odometry/uncertainty.h"

namespace point_line_odometry {
namespace {

constexpr double kPeriod_s = 0.1;

Parameters rolling() {
  Parameters parameters;
  parameters.tracking.rolling_shutter_ms = 20.0;
  return parameters;
}

/// Forwards and turning, at a constant acceleration in the camera's axes. \param t since it stood.
Vector6d velocityAt(double t) {
  Vector6d velocity;
  velocity << 0.0, 0.0, 2.0 * t, 0.0, 0.5 * t, 0.0;
  return velocity;
}

/// The motion to a frame from the one before, at the mean velocity, as T_curr_prev.
Eigen::Isometry3d motionTo(double t, double dt_s) {
  return motionAtVelocity(velocityAt(t - 0.5 * dt_s), dt_s).inverse();
}

CameraVelocity meanBefore(double t, double over_s) {
  CameraVelocity velocity;
  velocity.value = velocityAt(t - 0.5 * over_s);
  velocity.measured_over_s = over_s;
  return velocity;
}

TEST(FrameShutter, IsGlobalUnlessTheParameterSaysOtherwise) {
  const FrameShutter shutter;
  EXPECT_TRUE(shutter.predicted(meanBefore(1.0, kPeriod_s), kPeriod_s, {}).isGlobal());
  EXPECT_TRUE(shutter.measured(motionTo(1.0, kPeriod_s), kPeriod_s, {}, {}).isGlobal());
  EXPECT_FALSE(shutter.measured(motionTo(1.0, kPeriod_s), kPeriod_s, {}, rolling()).isGlobal());
}

/// The less is known of a velocity, the larger is its variance.
TEST(FrameShutter, IsPredictedByTheLastVelocity) {
  const FrameShutter shutter;
  const RollingShutter unknown = shutter.predicted({}, kPeriod_s, rolling());
  EXPECT_FALSE(unknown.isMeasured());
  EXPECT_TRUE(unknown.velocity().isZero());
  CameraVelocity last = meanBefore(1.0, kPeriod_s);
  const RollingShutter current = shutter.predicted(last, kPeriod_s, rolling());
  EXPECT_FALSE(current.isMeasured());
  EXPECT_EQ(current.velocity(), last.value);
  EXPECT_LT(current.variances().maxCoeff(), unknown.variances().minCoeff());
  last.is_current = false;
  const RollingShutter old = shutter.predicted(last, kPeriod_s, rolling());
  EXPECT_EQ(old.velocity(), last.value);
  EXPECT_GT(old.variances()[2], std::pow(last.value[2], 2));
}

/// From the means over two intervals, of different lengths, too.
TEST(FrameShutter, FollowsAConstantAcceleration) {
  const FrameShutter shutter;
  for (const double before_s : {kPeriod_s, 3.0 * kPeriod_s}) {
    const RollingShutter now = shutter.measured(motionTo(1.0, kPeriod_s), kPeriod_s,
                                                meanBefore(1.0 - kPeriod_s, before_s), rolling());
    EXPECT_TRUE(now.isMeasured());
    EXPECT_LT((now.velocity() - velocityAt(1.0)).norm(), 1e-3) << before_s;
  }
  CameraVelocity old = meanBefore(0.2, kPeriod_s);
  old.is_current = false;
  const RollingShutter now = shutter.measured(motionTo(1.0, kPeriod_s), kPeriod_s, old, rolling());
  EXPECT_LT((now.velocity() - velocityAt(1.0 - 0.5 * kPeriod_s)).norm(), 1e-3);
  EXPECT_GT(now.variances()[2], std::pow(2.0 * 0.5 * kPeriod_s, 2)) << "it is a mean only";
}

TEST(FrameShutter, LearnsHowWrongTheVelocityIs) {
  FrameShutter shutter;
  const auto variances = [&] {
    return shutter
        .measured(motionTo(1.2, kPeriod_s), kPeriod_s, meanBefore(1.1, kPeriod_s), rolling())
        .variances();
  };
  const Vector6d at_first = variances();
  EXPECT_GT(at_first.minCoeff(), 0.0);
  // A frame whose velocity was right, and one whose was wrong by 0.3 m/s along an axis.
  const auto learn = [&](const Vector6d& velocity) {
    shutter.learn(RollingShutter(0.02, velocity, Vector6d::Zero(), true),
                  meanBefore(1.0, kPeriod_s), motionTo(1.0 + kPeriod_s, kPeriod_s), kPeriod_s);
  };
  learn(velocityAt(1.0));
  EXPECT_LT(variances().maxCoeff(), at_first.maxCoeff());
  EXPECT_GT(variances().minCoeff(), 0.5 * at_first.minCoeff()) << "one frame says little";
  Vector6d wrong = velocityAt(1.0);
  wrong[2] += 0.3;
  for (int i = 0; i < 100; ++i) learn(wrong);
  EXPECT_NEAR(variances()[0], 0.03, 0.001) << "a third of the squared error for each axis";
  const RollingShutter later = shutter.measured(motionTo(1.3, 2.0 * kPeriod_s), 2.0 * kPeriod_s,
                                                meanBefore(1.1, kPeriod_s), rolling());
  EXPECT_NEAR(later.variances()[0], 4.0 * variances()[0], 1e-6) << "over twice the time";
  EXPECT_EQ(variances()[0], variances()[2]);
  EXPECT_LT(variances()[4], 1e-6);
}

TEST(FrameShutter, LearnsNothingWhereAVelocityIsNotMeasured) {
  FrameShutter shutter;
  const auto variances = [&] {
    return shutter.measured(motionTo(1.0, kPeriod_s), kPeriod_s, {}, rolling()).variances();
  };
  const Vector6d before = variances();
  const Eigen::Isometry3d next = motionTo(1.0 + kPeriod_s, kPeriod_s);
  const RollingShutter predicted(0.02, Vector6d::Zero(), Vector6d::Zero(), false);
  shutter.learn(predicted, meanBefore(1.0, kPeriod_s), next, kPeriod_s);
  const RollingShutter measured(0.02, Vector6d::Zero(), Vector6d::Zero(), true);
  shutter.learn(measured, std::nullopt, next, kPeriod_s);
  CameraVelocity of_another_time = meanBefore(1.0, kPeriod_s);
  of_another_time.is_current = false;
  shutter.learn(measured, of_another_time, next, kPeriod_s);
  EXPECT_EQ(variances(), before);
}

}  // namespace
}  // namespace point_line_odometry
