/// The motion over two frames and its fusion with that over one, by FrameTracker from the history.
/// fuseRotation() itself is tested by motion_test.

#include "odometry/frame_tracker.h"

#include <gtest/gtest.h>

#include "features/stereo_feature_detector.h"
#include "odometry/correspondences.h"
#include "odometry/stereo_triangulation.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using synthetic::transform;

const StereoCamera kCamera = synthetic::roomCamera();

/// Frames k-2, k-1 and k of a drive whose motion changes from frame to frame in every axis.
Isometry3d poseOf(int frame) {
  const Isometry3d first = transform({0.004, -0.03, 0.01}, {0.03, -0.01, 0.15});
  const Isometry3d second = transform({-0.012, 0.02, -0.015}, {-0.02, 0.015, 0.1});
  return frame == 0 ? Isometry3d::Identity() : frame == 1 ? first : first * second;
}

class FusionTest : public ::testing::Test {
 protected:
  FusionTest() {
    parameters_.window.size = 0;
    for (int i = 0; i < 3; ++i) {
      images_.push_back(
          synthetic::renderStereo(kCamera, poseOf(i), (i + 1) * synthetic::kPeriodNs));
    }
  }

  StereoFrame frameOf(int i) {
    const FrameContext context{images_[i], kCamera, correction_, parameters_};
    StereoFeatureDetector detector(parameters_.points, parameters_.lines);
    StereoFrame frame;
    frame.stamp_ns = images_[i].stamp_ns;
    frame.left_image = ImagePyramid(images_[i].left);
    frame.features = detector.detect(images_[i], LineResolution::kFull, &threads_);
    triangulateMatches(matchStereo(frame.features, correction_, parameters_.matching, &threads_),
                       context, &threads_, &frame);
    return frame;
  }

  /// The same in the dark: with points of a coarser level.
  StereoFrame darkFrameOf(int i) {
    StereoFrame frame = frameOf(i);
    frame.left_image.addLevels(parameters_.points);
    for (Keypoint& keypoint : frame.features.points_left) keypoint.octave = 1;
    return frame;
  }

  /// Tracks k-1 -> k. \param T_previous_before motion k-2 -> k-1; without it there is no frame k-2.
  TrackingResult track(const std::optional<Isometry3d>& T_previous_before) {
    FrameHistory history;
    history.previous = frameOf(1);
    if (T_previous_before)
      history.before_previous =
          FrameBeforePrevious{dark_before_ ? darkFrameOf(0) : frameOf(0), *T_previous_before};
    const FrameContext context{images_[2], kCamera, correction_, parameters_};
    const std::optional<CameraVelocity> velocity;
    const FramePrior prior;
    StageTimes times;
    const FrameTracker tracker(history, velocity, prior, context, &threads_, &times);
    return tracker.track(frameOf(2));
  }

  bool dark_before_ = false;
  Parameters parameters_;
  StereoCorrection correction_{kCamera};
  ThreadPool threads_{2};
  std::vector<StereoImages> images_;
};

Vector3d rotationBetween(const Isometry3d& from, const Isometry3d& to) {
  return logSO3(from.linear().transpose() * to.linear());
}

/// R' = R_curr_before R_previous_before^T: an error of the given motion k-2 -> k-1 is propagated to
/// it with the opposite sign, and to the fused rotation by half.
TEST_F(FusionTest, IsTheMeanOfBothRotations) {
  const Isometry3d T_previous_before = poseOf(1).inverse() * poseOf(0);
  const Isometry3d T_curr_previous = poseOf(2).inverse() * poseOf(1);
  const TrackingResult frame_to_frame = track(std::nullopt);
  ASSERT_EQ(frame_to_frame.reason, TrackingReason::kNone);
  ASSERT_LT(rotationBetween(frame_to_frame.motion.T_curr_prev, T_curr_previous).norm(), 0.0005);
  const TrackingResult agreeing = track(T_previous_before);
  ASSERT_EQ(agreeing.reason, TrackingReason::kNone);
  EXPECT_LT(rotationBetween(agreeing.motion.T_curr_prev, T_curr_previous).norm(), 0.0005);
  EXPECT_NE(agreeing.motion.T_curr_prev.matrix(), frame_to_frame.motion.T_curr_prev.matrix());
  for (int axis = 0; axis < 3; ++axis) {
    for (const double error_rad : {0.004, -0.004}) {
      Isometry3d wrong = T_previous_before;
      wrong.linear() = transform(error_rad * Vector3d::Unit(axis), Vector3d::Zero()).linear() *
                       T_previous_before.linear();
      const TrackingResult fused = track(wrong);
      ASSERT_EQ(fused.reason, TrackingReason::kNone);
      const Vector3d rotation =
          rotationBetween(agreeing.motion.T_curr_prev, fused.motion.T_curr_prev);
      const Vector3d expected = -0.5 * error_rad * Vector3d::Unit(axis);
      EXPECT_LT((rotation - expected).norm(), 0.05 * expected.norm()) << rotation.transpose();
      EXPECT_EQ(fused.frame_to_frame.T_curr_prev.matrix(), fused.motion.T_curr_prev.matrix());
    }
  }
}

/// The translation is estimated again: that of the frame-to-frame estimate does not fit another
/// rotation.
TEST_F(FusionTest, TheTranslationFitsTheFusedRotation) {
  const Isometry3d T_previous_before = poseOf(1).inverse() * poseOf(0);
  Isometry3d wrong = T_previous_before;
  wrong.linear() = transform({0.0, 0.004, 0.0}, Vector3d::Zero()).linear() * wrong.linear();
  const TrackingResult agreeing = track(T_previous_before);
  const TrackingResult fused = track(wrong);
  // A rotation of -2 mrad about y shifts the scene at 4 to 8 m by 8 to 16 mm along x.
  const Vector3d moved =
      fused.motion.T_curr_prev.translation() - agreeing.motion.T_curr_prev.translation();
  EXPECT_GT(moved.x(), 0.004);
  EXPECT_LT(moved.x(), 0.020);
}

/// Out of the dark: the current image has no levels any more, frame k-2 has points of one.
TEST_F(FusionTest, FrameBeforeMayHaveLevelsThatTheCurrentOneLacks) {
  dark_before_ = true;
  const TrackingResult fused = track(poseOf(1).inverse() * poseOf(0));
  ASSERT_EQ(fused.reason, TrackingReason::kNone);
  const Isometry3d T_curr_previous = poseOf(2).inverse() * poseOf(1);
  EXPECT_LT(rotationBetween(fused.motion.T_curr_prev, T_curr_previous).norm(), 0.002);
}

}  // namespace
}  // namespace point_line_odometry
