/// The odometry in the built-in world: what can only be asked where the truth is exact.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "odometry/uncertainty.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/stereo_odometry.h"
#include "point_line_odometry/synthetic_world.h"

namespace point_line_odometry {
namespace {

/// A run through a world: estimates and truth, both of the rectified left camera.
struct Passage {
  std::vector<FrameResult> results;
  std::vector<Eigen::Isometry3d> truth;  // relative to frame 0
};

Passage run(const SyntheticWorldOptions& options, std::size_t num_frames) {
  const SyntheticWorld world(options);
  const StereoRectifier rectifier(world.calibration());
  Eigen::Isometry3d T_rectified_raw = Eigen::Isometry3d::Identity();
  if (world.needsRectification()) T_rectified_raw.linear() = rectifier.R_rectified_raw();
  StereoOdometry odometry(rectifier.camera(), {});
  Passage passage;
  for (std::size_t k = 0; k < num_frames; ++k) {
    StereoImages images = world.render(k);
    if (world.needsRectification()) images = rectifier.rectify(images);
    passage.results.push_back(odometry.process(images));
    passage.truth.push_back(T_rectified_raw * world.pose(k).T_world_camera *
                            T_rectified_raw.inverse());
  }
  return passage;
}

double angleDeg(const Eigen::Matrix3d& R) { return Eigen::AngleAxisd(R).angle() * 180.0 / M_PI; }

/// Normalised squared errors of the velocities, six degrees of freedom each.
std::vector<double> normalisedErrors(const Passage& passage) {
  std::vector<double> errors;
  for (std::size_t k = 2; k < passage.results.size(); ++k) {
    const FrameResult& result = passage.results[k];
    EXPECT_EQ(result.state, TrackingState::kOk) << k << " " << toString(result.reason);
    const double dt_s =
        1e-9 * static_cast<double>(result.stamp_ns - passage.results[k - 1].stamp_ns);
    const Vector6d error =
        result.twist - velocityOfMotion(passage.truth[k - 1].inverse() * passage.truth[k], dt_s);
    errors.push_back(error.dot(result.twist_covariance.ldlt().solve(error)));
  }
  return errors;
}

class Consistency : public ::testing::TestWithParam<const char*> {};

/// The covariance says how wrong the velocity is: its error, normalised by it, has the mean square
/// 6. Never much more, which is what a filter suffers from; less where places are seen more sharply
/// than the floors of the noise say, as in the rooms (5.5 in the street, 1.4 in the rooms).
TEST_P(Consistency, VelocityErrorsAreNoLargerThanTheirCovarianceSays) {
  double sum = 0.0;
  std::size_t count = 0;
  for (const int seed : {1, 2, 3}) {
    SyntheticWorldOptions options;
    options.scene = GetParam();
    options.seed = seed;
    for (const double error : normalisedErrors(run(options, 25))) {
      sum += error;
      ++count;
    }
  }
  const double mean = sum / static_cast<double>(count);
  EXPECT_GT(mean, 1.0);
  EXPECT_LT(mean, 12.0);
  RecordProperty("mean_normalised_error", std::to_string(mean));
}

INSTANTIATE_TEST_SUITE_P(Worlds, Consistency, ::testing::Values("street", "indoor"));

/// A camera that turns to and fro about its own axis, at 100 deg/s in the middle.
std::vector<StampedPose> turns(std::size_t num_frames) {
  constexpr double kAmplitude_rad = 0.8;
  constexpr double kFastest_rad_s = 100.0 * M_PI / 180.0;
  std::vector<StampedPose> path(num_frames);
  for (std::size_t k = 0; k < num_frames; ++k) {
    const double time_s = 0.05 * static_cast<double>(k);
    const double yaw = kAmplitude_rad * (1.0 - std::cos(kFastest_rad_s / kAmplitude_rad * time_s));
    path[k].stamp_ns = static_cast<std::int64_t>(k) * 50'000'000;
    path[k].T_world_camera.linear() =
        Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()).toRotationMatrix();
  }
  return path;
}

/// 5 degrees from frame to frame at EuRoC's frame rate: the view moves by 40 pixels.
TEST(HardMotion, FastPureRotation) {
  constexpr std::size_t kFrames = 60;
  SyntheticWorldOptions options;
  options.scene = "indoor";
  options.path = turns(kFrames);
  const Passage turning = run(options, kFrames);
  double fastest_deg = 0.0;
  for (std::size_t k = 1; k < kFrames; ++k) {
    const FrameResult& result = turning.results[k];
    EXPECT_EQ(result.state, TrackingState::kOk) << k << " " << toString(result.reason);
    const Eigen::Isometry3d& truth = turning.truth[k];
    EXPECT_LT((result.T_odom_camera.translation() - truth.translation()).norm(), 0.01) << k;
    EXPECT_LT(angleDeg(result.T_odom_camera.linear().transpose() * truth.linear()), 0.3) << k;
    fastest_deg =
        std::max(fastest_deg, angleDeg(turning.truth[k - 1].linear().transpose() * truth.linear()));
  }
  EXPECT_GT(fastest_deg, 4.9) << "the test must be hard";
}

}  // namespace
}  // namespace point_line_odometry
