#include "odometry/pose_smoother.h"

#include <gtest/gtest.h>

namespace point_line_odometry {
namespace {

constexpr double kFrameTime_s = 0.15;

MotionStep stepForward(double way_m, double sigma_m, double sigma_rad) {
  MotionStep step;
  step.T_measured.translation().z() = way_m;
  step.T_previous_camera = step.T_measured;
  step.covariance.diagonal().head<3>().setConstant(sigma_m * sigma_m);
  step.covariance.diagonal().tail<3>().setConstant(sigma_rad * sigma_rad);
  step.error_correlation = 7.0;
  return step;
}

/// A camera whose pose is hardly known, as after a loss, and whose motion is then measured well.
class AfterALoss : public ::testing::Test {
 protected:
  AfterALoss() {
    estimate_.reset(Eigen::Isometry3d::Identity());
    pose_.reset(Eigen::Isometry3d::Identity());
    follow(stepForward(0.0, 0.2, 0.02));
  }

  void follow(const MotionStep& step) {
    stamp_ns_ += 150000000;
    estimate_.addMeasurement(step, kFrameTime_s, kFrameTime_s, stamp_ns_);
    pose_.followMeasured(estimate_, kFrameTime_s, true);
    estimate_.advance();
  }

  PoseIntegrator estimate_;
  PoseSmoother pose_;

 private:
  std::int64_t stamp_ns_ = 0;
};

TEST_F(AfterALoss, ACameraThatMovesIsNotHeld) {
  for (int k = 1; k <= 10; ++k) {
    follow(stepForward(0.15, 0.004, 0.0005));
    EXPECT_FALSE(pose_.holds()) << k;
    EXPECT_NEAR(pose_.T_odom_camera().translation().z(), 0.15 * k, 1e-9) << k;
  }
}

TEST_F(AfterALoss, ACameraThatStandsIsHeld) {
  for (int k = 1; k <= 10; ++k) {
    const double noise_m = k % 2 == 0 ? 0.004 : -0.004;
    follow(stepForward(noise_m, 0.004, 0.0005));
  }
  EXPECT_TRUE(pose_.holds());
  EXPECT_NEAR(pose_.T_odom_camera().translation().norm(), 0.0, 0.01);
}

/// Variances of the pose are ten orders above those of a motion then.
TEST_F(AfterALoss, ACameraThatStandsIsHeldAfterMinutes) {
  for (int k = 0; k < 1800; ++k) {
    estimate_.addPrediction(0.1, 0.5, {});
    pose_.followUnknown(estimate_, Vector6d::Zero(), 0.1);
  }
  estimate_.advance();
  int held = 0;
  for (int k = 0; k < 200; ++k) {
    follow(stepForward(k % 2 == 0 ? 3e-4 : -3e-4, 3e-4, 3e-5));
    held += pose_.holds() ? 1 : 0;
  }
  EXPECT_GT(held, 190);
}

}  // namespace
}  // namespace point_line_odometry
