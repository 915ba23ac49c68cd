
#include "point_line_odometry/stereo_odometry.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <functional>
#include <limits>
#include <optional>
#include <stdexcept>

#include "failing_allocator.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

using synthetic::black;
using synthetic::drive;
using synthetic::frame;
using synthetic::kFrames;
using synthetic::kPeriodNs;
using synthetic::roomParameters;
using synthetic::stamped;
using synthetic::truePose;

const StereoCamera kCamera = synthetic::roomCamera();

bool allFinite(const FrameResult& result) {
  return result.T_odom_camera.matrix().allFinite() && result.pose_covariance.allFinite() &&
         result.twist.allFinite() && result.twist_covariance.allFinite() &&
         std::isfinite(result.rms_px);
}

void expectPose(const FrameResult& result, const Isometry3d& ground_truth, double tolerance_m,
                double tolerance_rad) {
  EXPECT_LT((result.T_odom_camera.translation() - ground_truth.translation()).norm(), tolerance_m);
  EXPECT_LT(logSO3(result.T_odom_camera.linear().transpose() * ground_truth.linear()).norm(),
            tolerance_rad);
}

std::vector<FrameResult> run(const Parameters& parameters) {
  StereoOdometry odometry(kCamera, parameters);
  std::vector<FrameResult> results;
  for (int k = 0; k < kFrames; ++k) results.push_back(odometry.process(frame(k)));
  return results;
}

void expectTheDrive(const std::vector<FrameResult>& results, double tolerance_m,
                    double tolerance_rad) {
  for (int k = 1; k < kFrames; ++k) {
    ASSERT_EQ(results[k].state, TrackingState::kOk) << k << ' ' << toString(results[k].reason);
    EXPECT_EQ(results[k].reason, TrackingReason::kNone);
    expectPose(results[k], truePose(k), tolerance_m, tolerance_rad);
  }
}

// --- The drive

TEST(StereoOdometry, FirstFrameIsTheOrigin) {
  StereoOdometry odometry(kCamera, roomParameters());
  const FrameResult result = odometry.process(frame(0));
  EXPECT_EQ(result.state, TrackingState::kInitializing);
  EXPECT_EQ(result.reason, TrackingReason::kFirstFrame);
  EXPECT_TRUE(result.accepted());
  EXPECT_EQ(result.stamp_ns, kPeriodNs);
  EXPECT_EQ(result.T_odom_camera.matrix(), Isometry3d::Identity().matrix());
  EXPECT_TRUE(result.pose_covariance.isZero(0.0) && result.twist.isZero(0.0));
  EXPECT_GT(result.counts.points_left, 50);
  EXPECT_GT(result.counts.lines_left, 20);
  EXPECT_GT(result.counts.point_stereo_matches, 20);
  EXPECT_EQ(result.unmatched_points_px.size(), static_cast<std::size_t>(result.counts.points_left));
}

TEST(StereoOdometry, NumberOfThreadsChangesNothing) {
  Parameters parameters = roomParameters();
  parameters.tracking.threads = 1;
  const std::vector<FrameResult> alone = run(parameters);
  for (const int threads : {2, 5}) {
    parameters.tracking.threads = threads;
    const std::vector<FrameResult> shared = run(parameters);
    for (int k = 0; k < kFrames; ++k) {
      EXPECT_EQ(shared[k].T_odom_camera.matrix(), alone[k].T_odom_camera.matrix()) << k;
      EXPECT_EQ(shared[k].pose_covariance, alone[k].pose_covariance) << k;
      EXPECT_EQ(shared[k].counts.point_inliers, alone[k].counts.point_inliers) << k;
      EXPECT_EQ(shared[k].counts.line_inliers, alone[k].counts.line_inliers) << k;
    }
  }
}

TEST(StereoOdometry, RecoversAKnownMotion) {
  const std::vector<FrameResult> results = run(roomParameters());
  expectTheDrive(results, 0.015, 0.003);
  for (int k = 1; k < kFrames; ++k) {
    const FrameResult& result = results[k];
    EXPECT_TRUE(allFinite(result));
    EXPECT_GT(result.counts.point_inliers, 20);
    EXPECT_GT(result.counts.line_inliers, 5);
    EXPECT_LE(result.counts.point_inliers, result.counts.point_matches);
    EXPECT_LT(result.rms_px, 1.0);
    EXPECT_EQ(result.points.size(), static_cast<std::size_t>(result.counts.point_matches));
    // Velocity in the camera's own axes: 0.12 m in 0.1 s.
    EXPECT_NEAR(result.twist.head(3).norm(), truePose(1).translation().norm() / 0.1, 0.1);
    EXPECT_NEAR(result.twist(4), -0.12, 0.03);
  }
}

TEST(StereoOdometry, FindsAMotionFarFromThePrediction) {
  // After standing still the camera rotates by 25 degrees, 140 px, within a frame and continues so.
  const auto pose = [](int k) {
    return synthetic::transform({0.0, std::max(k - 2, 0) * 25.0 * M_PI / 180.0, 0.0},
                                std::max(k - 2, 0) * Vector3d(0.1, 0.0, 0.2));
  };
  StereoOdometry odometry(kCamera, roomParameters());
  for (int k = 0; k < 5; ++k) {
    const FrameResult result =
        odometry.process(synthetic::renderStereo(kCamera, pose(k), (k + 1) * kPeriodNs));
    if (k == 0) continue;
    ASSERT_EQ(result.state, TrackingState::kOk) << k << ' ' << toString(result.reason);
    expectPose(result, pose(k), 0.03, 0.006);
  }
}

TEST(StereoOdometry, ObservedPointsProjectToTheirPixels) {
  const FrameResult result = run(roomParameters()).back();
  ASSERT_GT(result.points.size(), 20U);
  float squares = 0.0F;
  float vertical = 0.0F;
  for (const ObservedPoint& point : result.points) {
    EXPECT_LT(
        (kCamera.projectLeft(point.p_camera.cast<double>()) - point.left_px.cast<double>()).norm(),
        0.01);
    EXPECT_LT((kCamera.projectRight(point.p_camera.cast<double>()) - point.right_px.cast<double>())
                  .norm(),
              3.0);
    // Of an exact camera: noise only, and none of what is no inlier.
    EXPECT_LT(point.residual_px.norm(), 3.0F);
    if (!point.inlier) {
      EXPECT_EQ(point.residual_px.norm(), 0.0F);
    }
    squares += point.residual_px.squaredNorm();
    vertical += std::abs(point.vertical_disparity_px);
  }
  const auto count = static_cast<float>(result.points.size());
  EXPECT_GT(squares, 0.0F);
  EXPECT_LT(std::sqrt(squares / count), 0.7F);
  EXPECT_LT(vertical / count, 0.4F);
  for (const ObservedLine& line : result.lines) {
    EXPECT_LT(
        (kCamera.projectLeft(line.start_camera.cast<double>()) - line.left_px.start.cast<double>())
            .norm(),
        0.01);
  }
}

TEST(StereoOdometry, CovarianceGrowsAndCoversTheError) {
  const std::vector<FrameResult> results = run(roomParameters());
  double first = 0.0;
  double last = 0.0;
  for (int k = 1; k < kFrames; ++k) {
    const Matrix6d& covariance = results[k].pose_covariance;
    const double variance = covariance.diagonal().head(3).sum();
    if (k == 1) first = variance;
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<Matrix6d>(covariance).eigenvalues().minCoeff(), 0.0);
    last = variance;
    const Vector3d error = results[k].T_odom_camera.translation() - truePose(k).translation();
    EXPECT_LT(error.norm(), 6.0 * std::sqrt(last)) << k;
  }
  EXPECT_GT(last, first);
}

TEST(StereoOdometry, SameInputTwiceIsBitIdentical) {
  Parameters parameters = roomParameters();
  parameters.window.keyframe_overlap = 0.95;  // for bundle adjustments
  const std::vector<FrameResult> first = run(parameters);
  // Other addresses in memory: results must not depend on their order.
  std::vector<std::vector<char>> held;
  for (std::size_t size = 16; size < 40000; size += size / 3) held.emplace_back(size);
  const std::vector<FrameResult> second = run(parameters);
  for (int k = 0; k < kFrames; ++k) {
    EXPECT_EQ(first[k].T_odom_camera.matrix(), second[k].T_odom_camera.matrix());
    EXPECT_EQ(first[k].pose_covariance, second[k].pose_covariance);
    EXPECT_EQ(first[k].counts.point_inliers, second[k].counts.point_inliers);
  }
}

/// At full size at first, and after a frame without any, a gap or a failure; not after a repeated
/// pair.
TEST(StereoOdometry, LinesAreCoarseToFineWherePointsAreManyAndMotionsKnown) {
  constexpr int kSettled = 5;  // motions
  constexpr int kDoubted = 7;
  const auto expectUntil = [](int doubted, const std::vector<StereoImages>& frames, int failing) {
    const auto detectedLines = [&](int coarse_to_fine_points) {
      Parameters parameters = roomParameters();
      parameters.lines.coarse_to_fine_points = coarse_to_fine_points;
      StereoOdometry odometry(kCamera, parameters);
      std::vector<int> lines;
      for (const StereoImages& images : frames) {
        std::optional<FailingAllocator> allocator;
        if (static_cast<int>(lines.size()) == failing) allocator.emplace(0);
        lines.push_back(odometry.process(images).counts.lines_left);
      }
      return lines;
    };
    const std::vector<int> coarse_to_fine = detectedLines(0);
    const std::vector<int> full = detectedLines(100000);
    const std::vector<int> by_points = detectedLines(20);
    int different = 0;
    for (int k = 0; k < static_cast<int>(frames.size()); ++k) {
      different += coarse_to_fine[k] != full[k] ? 1 : 0;
      EXPECT_EQ(by_points[k], k > kSettled && k < doubted ? coarse_to_fine[k] : full[k]) << k;
    }
    EXPECT_GE(different, static_cast<int>(frames.size()) - 1) << "of all but one without lines";
  };
  std::vector<StereoImages> frames;
  for (int k = 0; k <= kDoubted + 1; ++k) frames.push_back(drive(k));
  const std::int64_t doubted_ns = frames[kDoubted].stamp_ns;
  std::vector<StereoImages> with_black = frames;
  with_black[kDoubted] = black(doubted_ns);
  std::vector<StereoImages> with_gap(frames.begin(), frames.begin() + kDoubted + 1);
  with_gap.back().stamp_ns += 12 * kPeriodNs;
  std::vector<StereoImages> with_repeated = frames;
  with_repeated[kDoubted] = stamped(frames[kDoubted - 1], doubted_ns);
  constexpr int kNever = 100;
  expectUntil(kDoubted, with_black, kNever);
  expectUntil(kDoubted, with_gap, kNever);
  expectUntil(kDoubted, frames, kDoubted);
  expectUntil(kNever, with_repeated, kNever);
}

TEST(StereoOdometry, PointsOnly) {
  Parameters parameters = roomParameters();
  parameters.lines.enabled = false;
  const std::vector<FrameResult> results = run(parameters);
  expectTheDrive(results, 0.02, 0.004);
  EXPECT_EQ(results.back().counts.lines_left + results.back().counts.line_matches, 0);
  EXPECT_TRUE(results.back().lines.empty());
}

TEST(StereoOdometry, LinesOnly) {
  Parameters parameters = roomParameters();
  parameters.points.enabled = false;
  const std::vector<FrameResult> results = run(parameters);
  expectTheDrive(results, 0.05, 0.01);
  EXPECT_EQ(results.back().counts.points_left + results.back().counts.point_matches, 0);
  EXPECT_TRUE(results.back().points.empty());
}

TEST(StereoOdometry, PaperMode) {
  const std::vector<FrameResult> results =
      run(loadParameters(TEST_REPOSITORY_DIR "/config/paper.yaml"));
  expectTheDrive(results, 0.06, 0.01);
  EXPECT_EQ(results[1].times[Stage::kFuse], 0.0);  // there is no frame k-2 yet
  EXPECT_GT(results[2].times[Stage::kFuse], 0.0);
}

TEST(StereoOdometry, RotationsAreFusedWhereThereAreNoLandmarks) {
  for (const char* when : {"never", "without_landmarks", "always"}) {
    for (const int size : {0, 5}) {
      Parameters parameters = roomParameters();
      parameters.motion.fuse_rotation = when;
      parameters.window.size = size;
      const bool expected =
          std::string(when) == "always" || (std::string(when) != "never" && size == 0);
      EXPECT_EQ(run(parameters).back().times[Stage::kFuse] > 0.0, expected) << when << size;
    }
  }
}

TEST(StereoOdometry, OtherOptionsRun) {
  Parameters whole_pixels, plain_weights, levels;
  whole_pixels.matching.refine_subpixel = false;
  plain_weights.motion.use_triangulation_covariance = false;
  levels.points.levels = 3;
  for (const Parameters& other : {whole_pixels, plain_weights, levels}) {
    expectTheDrive(run(other), 0.06, 0.01);
  }
}

// --- Frames that are dropped

TEST(StereoOdometry, EqualAndOlderStampsAreDropped) {
  StereoOdometry odometry(kCamera, roomParameters());
  odometry.process(frame(0));
  const FrameResult good = odometry.process(frame(1));
  for (const std::int64_t stamp_ns :
       {2 * kPeriodNs, kPeriodNs, std::int64_t{0}, std::int64_t{-5}}) {
    const FrameResult dropped = odometry.process(stamped(frame(5), stamp_ns));
    EXPECT_EQ(dropped.reason, TrackingReason::kStampNotNewer);
    EXPECT_FALSE(dropped.accepted());
    EXPECT_EQ(dropped.state, TrackingState::kOk);
    EXPECT_EQ(dropped.T_odom_camera.matrix(), good.T_odom_camera.matrix());
  }
  const FrameResult next = odometry.process(frame(2));
  EXPECT_EQ(next.T_odom_camera.matrix(), run(roomParameters())[2].T_odom_camera.matrix())
      << "the dropped ones have no effect";
}

TEST(StereoOdometry, WrongImagesAreDropped) {
  StereoOdometry odometry(kCamera, roomParameters());
  odometry.process(frame(0));
  odometry.process(frame(1));
  cv::Mat colour(kCamera.height, kCamera.width, CV_8UC3, cv::Scalar::all(9));
  const cv::Mat small(kCamera.height - 1, kCamera.width, CV_8UC1, cv::Scalar(9));
  const cv::Mat deep(kCamera.height, kCamera.width, CV_16UC1, cv::Scalar(9));
  for (const cv::Mat& wrong : {cv::Mat(), colour, small, deep}) {
    for (const bool left : {true, false}) {
      StereoImages images = stamped(frame(2), 25 * kPeriodNs / 10);
      (left ? images.left : images.right) = wrong;
      const FrameResult dropped = odometry.process(images);
      EXPECT_EQ(dropped.reason, TrackingReason::kWrongImages);
      EXPECT_FALSE(dropped.accepted());
    }
  }
  EXPECT_EQ(odometry.process(frame(2)).T_odom_camera.matrix(),
            run(roomParameters())[2].T_odom_camera.matrix());
}

TEST(StereoOdometry, ImagesMayBeOverwrittenAfterwards) {
  StereoOdometry odometry(kCamera, roomParameters());
  StereoImages buffer{frame(0).left.clone(), frame(0).right.clone(), frame(0).stamp_ns};
  odometry.process(buffer);
  buffer.left.setTo(0);
  buffer.right.setTo(0);
  EXPECT_EQ(odometry.process(frame(1)).T_odom_camera.matrix(),
            run(roomParameters())[1].T_odom_camera.matrix());
}

// --- Lost tracking and relocalization; see faults_test as well

TEST(StereoOdometry, AnotherSceneStartsANewMapWhenLost) {
  StereoOdometry odometry(kCamera, roomParameters());
  FrameResult last;
  for (int k = 0; k < 3; ++k) last = odometry.process(frame(k));
  const Isometry3d about = synthetic::transform({0.0, M_PI, 0.0}, Vector3d::Zero());
  const StereoImages behind = synthetic::renderStereo(kCamera, truePose(2) * about, 0);
  const StereoImages after = synthetic::renderStereo(kCamera, truePose(3) * about, 0);
  for (int i = 1; i <= 7; ++i) {
    const FrameResult result = odometry.process(stamped(behind, (3 + i) * kPeriodNs));
    EXPECT_TRUE(allFinite(result));
    EXPECT_EQ(result.state == TrackingState::kDegraded, i <= 5) << i << toString(result.reason);
    EXPECT_TRUE(i == 7 || result.pose_covariance.trace() > last.pose_covariance.trace()) << i;
    last = result;
  }
  EXPECT_EQ(last.state, TrackingState::kOk) << "tracking started again, and no motion since";
  const FrameResult next = odometry.process(stamped(after, 11 * kPeriodNs));
  EXPECT_EQ(next.state, TrackingState::kOk) << toString(next.reason);
  EXPECT_GE(next.pose_covariance.trace(), 0.9 * last.pose_covariance.trace())
      << "its pose is unknown";
  const Isometry3d moved = last.T_odom_camera.inverse() * next.T_odom_camera;
  const Isometry3d ground_truth = (truePose(2) * about).inverse() * truePose(3) * about;
  EXPECT_LT((moved.translation() - ground_truth.translation()).norm(), 0.02);
}

TEST(StereoOdometry, AShortBlackoutIsBridgedByTheImages) {
  StereoOdometry odometry(kCamera, roomParameters());
  for (int k = 0; k < 4; ++k) odometry.process(frame(k));
  EXPECT_EQ(odometry.process(black(5 * kPeriodNs)).state, TrackingState::kDegraded);
  const FrameResult result = odometry.process(frame(5));
  EXPECT_EQ(result.state, TrackingState::kOk) << toString(result.reason);
  expectPose(result, truePose(5), 0.02, 0.004);
}

TEST(StereoOdometry, BlackFromTheStart) {
  StereoOdometry odometry(kCamera, roomParameters());
  for (int k = 0; k < 3; ++k) {
    const FrameResult result = odometry.process(black((k + 1) * kPeriodNs));
    EXPECT_TRUE(allFinite(result));
    EXPECT_NE(result.state, TrackingState::kOk);
    EXPECT_EQ(result.T_odom_camera.matrix(), Isometry3d::Identity().matrix());
  }
  FrameResult result;
  for (int k = 3; k < kFrames; ++k)
    result = odometry.process(stamped(frame(k), (k + 10) * kPeriodNs));
  EXPECT_EQ(result.state, TrackingState::kOk);
}

TEST(StereoOdometry, TooFastIsRejected) {
  Parameters parameters = roomParameters();
  parameters.tracking.max_speed_m_s = 1.0;  // the camera moves at 1.2
  EXPECT_EQ(run(parameters)[1].reason, TrackingReason::kTooFast);
  parameters = {};
  parameters.tracking.max_turn_rate_deg_s = 5.0;  // 7 deg/s
  EXPECT_EQ(run(parameters)[1].reason, TrackingReason::kTooFast);
}

// --- Reset, camera and parameters

TEST(StereoOdometry, ResetStartsAtThePose) {
  StereoOdometry odometry(kCamera, roomParameters());
  for (int k = 0; k < 3; ++k) odometry.process(frame(k));
  const Isometry3d start = synthetic::transform({0.1, 0.2, 0.3}, {5.0, 6.0, 7.0});
  odometry.reset(start);
  const FrameResult first =
      odometry.process(stamped(frame(0), 1));  // older stamps are accepted again
  EXPECT_EQ(first.reason, TrackingReason::kFirstFrame);
  EXPECT_EQ(first.T_odom_camera.matrix(), start.matrix());
  EXPECT_TRUE(first.pose_covariance.isZero(0.0) && first.twist.isZero(0.0));
  EXPECT_GT(first.twist_covariance.diagonal().minCoeff(), 1.0) << "the velocity is unknown";
  const FrameResult second = odometry.process(stamped(frame(1), 1 + kPeriodNs));
  expectPose(second, start * truePose(1), 0.01, 0.003);
}

TEST(StereoOdometry, ANewCameraContinuesFromThePose) {
  StereoOdometry odometry(kCamera, roomParameters());
  for (int k = 0; k < 3; ++k) odometry.process(frame(k));
  const FrameResult before = odometry.process(frame(3));
  StereoCamera other = kCamera;
  other.cx += 0.2;
  odometry.setCamera(other);
  const FrameResult first = odometry.process(frame(4));
  EXPECT_EQ(first.reason, TrackingReason::kFirstFrame);
  EXPECT_EQ(first.state, TrackingState::kDegraded);
  expectPose(first, truePose(4), 0.03, 0.01);  // predicted from the velocity
  EXPECT_GT(first.pose_covariance.trace(), 2.0 * before.pose_covariance.trace());
  const FrameResult next = odometry.process(frame(5));
  EXPECT_EQ(next.state, TrackingState::kOk);
  expectPose(next, first.T_odom_camera * truePose(4).inverse() * truePose(5), 0.02, 0.005);
}

TEST(StereoOdometry, OtherParametersDoNotInterruptTracking) {
  Parameters points_only = roomParameters();
  Parameters no_window = points_only;
  Parameters larger_window = points_only;
  Parameters more_levels = points_only;
  Parameters two_frames = points_only;
  points_only.lines.enabled = false;
  no_window.window.size = 0;
  larger_window.window.size = 7;
  more_levels.points.levels = 3;
  two_frames.motion.fuse_rotation = "always";
  for (const Parameters& other : {points_only, no_window, larger_window, more_levels, two_frames}) {
    StereoOdometry odometry(kCamera, roomParameters());
    for (int k = 0; k < kFrames; ++k) {
      if (k == 3) odometry.setParameters(other);
      if (k == 6) odometry.setParameters(roomParameters());
      const FrameResult result = odometry.process(frame(k));
      expectPose(result, truePose(k), 0.03, 0.006);
      if (k == 0) continue;
      EXPECT_EQ(result.state, TrackingState::kOk) << k << ' ' << toString(result.reason);
    }
  }
}

TEST(StereoOdometry, OnlyWindowAndMapParametersDiscardTheLandmarks) {
  for (const bool of_landmarks : {false, true}) {
    StereoOdometry odometry(kCamera, roomParameters());
    for (int k = 0; k < 4; ++k) odometry.process(frame(k));
    Parameters other = roomParameters();
    (of_landmarks ? other.local_map.size : other.lines.max_count) = 50;
    odometry.setParameters(other);
    EXPECT_EQ(odometry.process(frame(4)).counts.map_points == 0, of_landmarks);
  }
}

/// Levels of known points would be those of another zoom.
TEST(StereoOdometry, AnotherPyramidRestartsTracking) {
  StereoOdometry odometry(kCamera, roomParameters());
  for (int k = 0; k < 3; ++k) odometry.process(frame(k));
  Parameters other = roomParameters();
  other.points.scale_factor = 2.0;
  odometry.setParameters(other);
  EXPECT_EQ(odometry.process(frame(3)).reason, TrackingReason::kFirstFrame);
  EXPECT_EQ(odometry.process(frame(4)).state, TrackingState::kOk);
}

TEST(StereoOdometry, AnotherDescriptorRestartsTracking) {
  StereoOdometry odometry(kCamera, roomParameters());
  for (int k = 0; k < 3; ++k) odometry.process(frame(k));
  const FrameResult before = odometry.process(frame(3));
  Parameters other;
  other.points.descriptor = "orb";
  odometry.setParameters(other);
  const FrameResult first = odometry.process(frame(4));
  EXPECT_EQ(first.reason, TrackingReason::kFirstFrame) << "the old descriptors cannot be compared";
  EXPECT_EQ(first.state, TrackingState::kDegraded);
  EXPECT_GT(first.pose_covariance.trace(), before.pose_covariance.trace());
  expectPose(first, truePose(4), 0.03, 0.01);  // predicted from the velocity
  const FrameResult next = odometry.process(frame(5));
  EXPECT_EQ(next.state, TrackingState::kOk);
  expectPose(next, first.T_odom_camera * truePose(4).inverse() * truePose(5), 0.02, 0.005);
}

/// The camera is covered in motion, and uncovered seconds later where it was.
TEST(StereoOdometry, AVelocityFromSecondsAgoPredictsNothing) {
  Parameters parameters = roomParameters();
  parameters.matching.wide_search = false;
  parameters.window.size = 0;  // nor does a map help
  StereoOdometry odometry(kCamera, parameters);
  int k = 0;
  for (; k < 4; ++k) odometry.process(frame(k));
  for (; k < 54; ++k) odometry.process(synthetic::black((k + 1) * kPeriodNs));
  const FrameResult found = odometry.process(stamped(frame(3), (k + 1) * kPeriodNs));
  EXPECT_EQ(found.reason, TrackingReason::kNone);
  EXPECT_EQ(found.state, TrackingState::kOk);
}

// --- Saved and restored

/// All of a result but the times.
void expectSame(const FrameResult& a, const FrameResult& b) {
  EXPECT_EQ(a.stamp_ns, b.stamp_ns);
  EXPECT_EQ(a.state, b.state);
  EXPECT_EQ(a.reason, b.reason);
  EXPECT_EQ(a.T_odom_camera.matrix(), b.T_odom_camera.matrix());
  EXPECT_EQ(a.pose_covariance, b.pose_covariance);
  EXPECT_EQ(a.twist, b.twist);
  EXPECT_EQ(a.twist_covariance, b.twist_covariance);
  EXPECT_EQ(a.rms_px, b.rms_px);
  EXPECT_EQ(a.counts.map_points, b.counts.map_points);
  EXPECT_EQ(a.counts.map_lines, b.counts.map_lines);
  EXPECT_EQ(a.counts.map_point_inliers, b.counts.map_point_inliers);
  EXPECT_EQ(a.counts.map_line_inliers, b.counts.map_line_inliers);
  EXPECT_EQ(a.counts.keyframes, b.counts.keyframes);
  EXPECT_EQ(a.counts.failed_windows, b.counts.failed_windows);
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i)
    EXPECT_EQ(a.points[i].p_camera, b.points[i].p_camera);
}

/// A drive whose frame 4 is black, from which a run begun at any frame must not differ.
void expectTheSameFromEveryFrame(const Parameters& parameters) {
  const auto images = [](int k) { return k == 4 ? black((k + 1) * kPeriodNs) : frame(k); };
  StereoOdometry odometry(kCamera, parameters);
  odometry.reset(Isometry3d(Eigen::Translation3d(5.0, -2.0, 1.0)));
  std::vector<std::string> states;
  std::vector<FrameResult> results;
  std::vector<FrameResult> dropped;
  for (int k = 0; k < kFrames; ++k) {
    states.push_back(odometry.saveState());
    dropped.push_back(odometry.process({}));
    results.push_back(odometry.process(images(k)));
  }
  StereoOdometry other(kCamera, parameters);
  for (int begin = kFrames - 1; begin >= 0; --begin) {
    other.restoreState(states[begin]);
    expectSame(other.process({}), dropped[begin]);
    for (int k = begin; k < kFrames; ++k) expectSame(other.process(images(k)), results[k]);
  }
}

TEST(StereoOdometryState, ContinuesWithTheSameBits) {
  Parameters many_keyframes;
  many_keyframes.window.keyframe_overlap = 0.95;
  expectTheSameFromEveryFrame(many_keyframes);
  Parameters small_map = many_keyframes;
  small_map.window.size = 3;
  small_map.local_map.size = 0;
  expectTheSameFromEveryFrame(small_map);
  Parameters by_landmarks;
  by_landmarks.tracking.landmark_frames = 1;
  expectTheSameFromEveryFrame(by_landmarks);
  Parameters frame_to_frame;
  frame_to_frame.window.size = 0;
  frame_to_frame.motion.fuse_rotation = "always";
  expectTheSameFromEveryFrame(frame_to_frame);
}

TEST(StereoOdometryState, SavingChangesNothing) {
  Parameters parameters = roomParameters();
  parameters.window.keyframe_overlap = 0.95;
  const std::vector<FrameResult> results = run(parameters);
  StereoOdometry odometry(kCamera, parameters);
  for (int k = 0; k < kFrames; ++k) {
    odometry.saveState();
    expectSame(odometry.process(frame(k)), results[k]);
  }
  EXPECT_GT(results.back().counts.keyframes, 3);
}

TEST(StereoOdometryState, DamagedBytesAreRefused) {
  StereoOdometry odometry(kCamera, roomParameters());
  for (int k = 0; k < 3; ++k) odometry.process(frame(k));
  const std::string state = odometry.saveState();
  for (std::size_t size = 0; size < state.size(); size += 1 + state.size() / 50)
    EXPECT_THROW(odometry.restoreState(state.substr(0, size)), std::invalid_argument) << size;
  EXPECT_THROW(odometry.restoreState(state + '\0'), std::invalid_argument);
  EXPECT_THROW(odometry.restoreState(std::string(state.size(), '\xff')), std::invalid_argument);
  EXPECT_EQ(odometry.saveState(), state);
  EXPECT_EQ(odometry.process(frame(3)).state, TrackingState::kOk);
}

TEST(StereoOdometry, BadCameraAndParametersThrowAndAreNamed) {
  const auto expectNamed = [](const std::vector<const char*>& names,
                              const std::function<void()>& work) {
    try {
      work();
      ADD_FAILURE() << names[0] << " was not refused";
    } catch (const std::invalid_argument& error) {
      for (const char* name : names)
        EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
    }
  };
  StereoCamera swapped = kCamera;
  swapped.baseline_m = -0.2;
  Parameters bad;
  bad.points.levels = 0;
  bad.motion.huber_delta = std::numeric_limits<double>::quiet_NaN();
  expectNamed({"baseline_m"}, [&] { StereoOdometry(swapped, {}); });
  expectNamed({"points/levels", "motion/huber_delta"}, [&] { StereoOdometry(kCamera, bad); });
  StereoOdometry odometry(kCamera, roomParameters());
  expectNamed({"baseline_m"}, [&] { odometry.setCamera(swapped); });
  expectNamed({"points/levels", "motion/huber_delta"}, [&] { odometry.setParameters(bad); });
  EXPECT_EQ(odometry.camera(), kCamera);  // and nothing has changed
}

}  // namespace
}  // namespace point_line_odometry
