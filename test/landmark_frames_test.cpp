/// Frames that are tracked by landmarks alone (tracking/landmark_frames).

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <functional>
#include <opencv2/core.hpp>
#include <vector>

#include "geometry/se3.h"
#include "odometry/uncertainty.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_odometry.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using synthetic::drive;
using synthetic::kPeriodNs;
using synthetic::room;
using synthetic::stamped;
using synthetic::transform;
using synthetic::truePose;

constexpr int kSettled = 5;  // motions with features before the first one without
constexpr int kNumFrames = 14;
const StereoCamera kCamera = synthetic::roomCamera();

Parameters everySecond() {
  Parameters parameters;
  parameters.tracking.landmark_frames = 1;
  return parameters;
}

using Images = std::function<StereoImages(int)>;

std::vector<FrameResult> run(const Images& images, const Parameters& parameters = everySecond(),
                             int num_frames = kNumFrames) {
  StereoOdometry odometry(kCamera, parameters);
  std::vector<FrameResult> results;
  for (int k = 0; k < num_frames; ++k) results.push_back(odometry.process(images(k)));
  return results;
}

int countByLandmarks(const std::vector<FrameResult>& results) {
  return static_cast<int>(
      std::count_if(results.begin(), results.end(),
                    [](const FrameResult& result) { return result.by_landmarks; }));
}

void expectPose(const FrameResult& result, int k, double most_m = 0.02, double most_rad = 0.005) {
  EXPECT_LT((result.T_odom_camera.translation() - truePose(k).translation()).norm(), most_m) << k;
  EXPECT_LT(rotationAngle(result.T_odom_camera.linear().transpose() * truePose(k).linear()),
            most_rad)
      << k;
}

TEST(LandmarkFrames, AreEverySecondOneOnceMotionsAreKnown) {
  const std::vector<FrameResult> results = run(drive);
  for (int k = 0; k < kNumFrames; ++k) {
    const FrameResult& result = results[k];
    expectPose(result, k);
    EXPECT_EQ(result.by_landmarks, k > kSettled && (k - kSettled) % 2 == 1) << k;
    if (k > 0) {
      EXPECT_EQ(result.state, TrackingState::kOk) << k;
    }
  }
}

TEST(LandmarkFrames, ReportWhatTheyAreTrackedBy) {
  for (const FrameResult& result : run(drive)) {
    EXPECT_EQ(result.by_landmarks && result.counts.points_left + result.counts.lines_left > 0,
              false);
    if (!result.by_landmarks) continue;
    EXPECT_EQ(result.times[Stage::kDetect], 0.0);
    EXPECT_GT(result.counts.point_inliers, 100);
    EXPECT_GT(result.counts.line_inliers, 10);
    EXPECT_EQ(result.counts.map_point_inliers, result.counts.point_inliers);
    ASSERT_GE(static_cast<int>(result.points.size()), result.counts.point_inliers);
    ASSERT_GE(result.lines.size(), 10U);
    for (const ObservedPoint& point : result.points) {
      const Eigen::Vector3d p = point.p_camera.cast<double>();
      EXPECT_LT((kCamera.projectLeft(p).cast<float>() - point.left_px).norm(), 0.01F);
      EXPECT_LT((kCamera.projectRight(p).cast<float>() - point.right_px).norm(), 2.0F);
    }
    for (const ObservedLine& line : result.lines) {
      const Eigen::Vector3d p = line.end_camera.cast<double>();
      EXPECT_LT((kCamera.projectLeft(p).cast<float>() - line.left_px.end).norm(), 0.01F);
    }
  }
}

/// Also after one, when the motion is measured since an earlier frame.
TEST(LandmarkFrames, VelocityAndImageMotionAreSinceTheLastFrame) {
  const std::vector<FrameResult> results = run(drive);
  const double dt_s = 1e-9 * kPeriodNs;
  for (int k = 2; k < kNumFrames; ++k) {
    const Isometry3d T_last_curr = truePose(k - 1).inverse() * truePose(k);
    const Vector6d error = results[k].twist - velocityOfMotion(T_last_curr, dt_s);
    const Vector6d sigmas = results[k].twist_covariance.diagonal().cwiseSqrt();
    EXPECT_LT(error.cwiseAbs().cwiseQuotient(sigmas).maxCoeff(), 5.0) << k;
    EXPECT_LT(error.head<3>().norm(), 0.05) << k;
    EXPECT_NEAR(results[k].twist_over_s, dt_s, 1e-9) << k;
    ASSERT_TRUE(results[k].image_motion) << k;
    EXPECT_EQ(results[k].image_motion->from_ns, results[k - 1].stamp_ns) << k;
    EXPECT_LT(
        (results[k].image_motion->T_prev_curr.translation() - T_last_curr.translation()).norm(),
        0.005)
        << k;
  }
}

TEST(LandmarkFrames, AreAsManyInARowAsAllowed) {
  for (const int most : {0, 1, 3}) {
    Parameters parameters;
    parameters.tracking.landmark_frames = most;
    int in_a_row = 0;
    int longest = 0;
    for (const FrameResult& result : run(drive, parameters)) {
      in_a_row = result.by_landmarks ? in_a_row + 1 : 0;
      longest = std::max(longest, in_a_row);
    }
    EXPECT_EQ(longest, most);
  }
}

TEST(LandmarkFrames, DoNotDependOnTheThreads) {
  Parameters one = everySecond();
  one.tracking.threads = 1;
  Parameters three = everySecond();
  three.tracking.threads = 3;
  const std::vector<FrameResult> a = run(drive, one);
  const std::vector<FrameResult> b = run(drive, three);
  EXPECT_GT(countByLandmarks(a), 3);
  for (int k = 0; k < kNumFrames; ++k) {
    EXPECT_EQ(a[k].T_odom_camera.matrix(), b[k].T_odom_camera.matrix()) << k;
    EXPECT_EQ(a[k].twist_covariance, b[k].twist_covariance) << k;
  }
}

// --- Features are detected where landmarks alone leave a doubt

/// Frame 6 would be tracked by landmarks, frame 7 is the first with features after one that was.
class InDoubt : public ::testing::TestWithParam<int> {};

TEST_P(InDoubt, AfterASuddenTurn) {
  const auto turned = [](int k) {
    const double angle_rad = k >= GetParam() ? 0.1 : 0.0;
    return truePose(k) * transform({0.0, angle_rad, 0.0}, {0.0, 0.0, 0.0});
  };
  const auto results = run(
      [&](int k) { return room("turned " + std::to_string(GetParam() * 100 + k), turned(k), k); });
  EXPECT_FALSE(results[GetParam()].by_landmarks);
  for (int k = 1; k < kNumFrames; ++k) {
    EXPECT_EQ(results[k].state, TrackingState::kOk) << k;
    EXPECT_LT(rotationAngle(results[k].T_odom_estimate.linear().transpose() * turned(k).linear()),
              0.005)
        << k;
  }
}

TEST_P(InDoubt, BehindSomethingLarge) {
  const auto results = run([](int k) {
    StereoImages images = drive(k);
    if (k < GetParam()) return images;
    for (cv::Mat* image : {&images.left, &images.right})
      image->colRange(0, image->cols / 2).setTo(90);
    return images;
  });
  for (int k = GetParam(); k < std::min(GetParam() + 2, kNumFrames); ++k) {
    expectPose(results[k], k);
    EXPECT_FALSE(k == GetParam() && results[k].by_landmarks);
  }
}

/// Most of the view begins to move by itself, as in Faults.MostOfTheViewMoves.
TEST_P(InDoubt, WhereMostOfTheViewMoves) {
  const auto results = run([](int k) { return synthetic::passingFrom(GetParam(), k); });
  for (int k = 0; k < kNumFrames; ++k) expectPose(results[k], k, 0.04, 0.008);
}

TEST_P(InDoubt, AfterAFrameThatShowsNothing) {
  const auto results =
      run([](int k) { return k == GetParam() ? synthetic::black(drive(k).stamp_ns) : drive(k); });
  EXPECT_NE(results[GetParam()].state, TrackingState::kOk);
  for (int k = GetParam(); k < GetParam() + kSettled; ++k)
    EXPECT_FALSE(results[k].by_landmarks) << k;
  expectPose(results.back(), kNumFrames - 1, 0.03);
}

TEST_P(InDoubt, NotWhereTheDriverRepeatsImages) {
  const auto results = run([](int k) {
    const auto shown = [](int i) { return synthetic::noisy(drive(i), 1.0); };
    return k == GetParam() ? stamped(shown(k - 1), drive(k).stamp_ns) : shown(k);
  });
  EXPECT_EQ(results[GetParam()].reason, TrackingReason::kRepeatedImages);
  expectPose(results.back(), kNumFrames - 1, 0.03);
}

INSTANTIATE_TEST_SUITE_P(LandmarkFrames, InDoubt, ::testing::Values(6, 7));

TEST(LandmarkFrames, AreNoneOfASlowCamera) {
  const auto results = run([](int k) { return stamped(drive(k), (k + 1) * 6 * kPeriodNs); });
  EXPECT_EQ(countByLandmarks(results), 0) << "the next one would be too long after the previous";
  for (int k = 1; k < kNumFrames; ++k) EXPECT_EQ(results[k].state, TrackingState::kOk) << k;
}

TEST(LandmarkFrames, AreNoneWithARollingShutter) {
  Parameters parameters = everySecond();
  parameters.tracking.rolling_shutter_ms = 1.0;
  EXPECT_EQ(countByLandmarks(run(drive, parameters)), 0);
}

}  // namespace
}  // namespace point_line_odometry
