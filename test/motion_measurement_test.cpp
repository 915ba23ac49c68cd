/// The motion over two frames and its fusion with that over one, as MotionMeter makes it of what
/// earlier frames have left. fuseRotation() itself is tested by motion_test.

#include "odometry/motion_measurement.h"

#include <gtest/gtest.h>

#include "odometry/correspondences.h"
#include "point_line_odometry/stereo_feature_detector.h"
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
    frame.features = detector.detect(images_[i], &threads_);
    triangulateMatches(matchStereo(frame.features, parameters_.matching, &threads_), context,
                       &threads_, &frame);
    return frame;
  }

  /// The motion k-1 -> k. \param T_reference_before what is known of the motion k-2 -> k-1; without
  /// it nothing is known of frame k-2.
  MotionMeasurement measure(const std::optional<Isometry3d>& T_reference_before) {
    FrameHistory history;
    history.reference = frameOf(1);
    if (T_reference_before)
      history.before_reference = EarlierFrame{frameOf(0), *T_reference_before};
    const FrameContext context{images_[2], kCamera, correction_, parameters_};
    const std::optional<CameraVelocity> velocity;
    StageTimes times;
    const MotionMeter meter(history, velocity, context, &threads_, &times);
    return meter.measure(frameOf(2));
  }

  Parameters parameters_;
  RightImageCorrection correction_{kCamera};
  ThreadPool threads_{2};
  std::vector<StereoImages> images_;
};

Vector3d turn(const Isometry3d& from, const Isometry3d& to) {
  return synthetic::logarithm(from.linear().transpose() * to.linear());
}

/// R' = R_curr_before R_reference_before^T: an error of the known motion k-2 -> k-1, put in by
/// hand, comes out of it with the opposite sign, and by half out of the fusion.
TEST_F(FusionTest, TakesHalfOfWhatTheTwoFramesSay) {
  const Isometry3d T_reference_before = poseOf(1).inverse() * poseOf(0);
  const Isometry3d T_curr_reference = poseOf(2).inverse() * poseOf(1);
  const MotionMeasurement direct = measure(std::nullopt);
  ASSERT_EQ(direct.reason, TrackingReason::kNone);
  ASSERT_LT(turn(direct.motion.T_curr_prev, T_curr_reference).norm(), 0.0005);
  const MotionMeasurement agreeing = measure(T_reference_before);
  ASSERT_EQ(agreeing.reason, TrackingReason::kNone);
  EXPECT_LT(turn(agreeing.motion.T_curr_prev, T_curr_reference).norm(), 0.0005);
  EXPECT_NE(agreeing.motion.T_curr_prev.matrix(), direct.motion.T_curr_prev.matrix());
  for (int axis = 0; axis < 3; ++axis) {
    for (const double error_rad : {0.004, -0.004}) {
      Isometry3d wrong = T_reference_before;
      wrong.linear() = transform(error_rad * Vector3d::Unit(axis), Vector3d::Zero()).linear() *
                       T_reference_before.linear();
      const MotionMeasurement fused = measure(wrong);
      ASSERT_EQ(fused.reason, TrackingReason::kNone);
      const Vector3d turned = turn(agreeing.motion.T_curr_prev, fused.motion.T_curr_prev);
      const Vector3d expected = -0.5 * error_rad * Vector3d::Unit(axis);
      EXPECT_LT((turned - expected).norm(), 0.05 * expected.norm()) << turned.transpose();
      EXPECT_EQ(fused.direct.T_curr_prev.matrix(), fused.motion.T_curr_prev.matrix());
    }
  }
}

/// The translation is solved for again: that of the direct solution does not fit another rotation.
TEST_F(FusionTest, TheTranslationFitsTheFusedRotation) {
  const Isometry3d T_reference_before = poseOf(1).inverse() * poseOf(0);
  Isometry3d wrong = T_reference_before;
  wrong.linear() = transform({0.0, 0.004, 0.0}, Vector3d::Zero()).linear() * wrong.linear();
  const MotionMeasurement agreeing = measure(T_reference_before);
  const MotionMeasurement fused = measure(wrong);
  // Turned by -2 mrad about y, the scene at 4 to 8 m seems to have moved by 8 to 16 mm along x.
  const Vector3d moved =
      fused.motion.T_curr_prev.translation() - agreeing.motion.T_curr_prev.translation();
  EXPECT_GT(moved.x(), 0.004);
  EXPECT_LT(moved.x(), 0.020);
}

}  // namespace
}  // namespace point_line_odometry
