/// How much of the scene must be found at a motion, of frames of points with known positions.

#include "odometry/motion_confirmation.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <vector>

#include "odometry/odometry_pose.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

const StereoCamera kCamera = synthetic::roomCamera();

/// Points on the optical axis, three metres away: in view unless the camera moves.
StereoFrame frameOf(int num_points) {
  StereoFrame frame;
  frame.points.resize(static_cast<std::size_t>(num_points));
  for (StereoPoint& point : frame.points) point.triangulated.p_camera.z() = 3.0;
  return frame;
}

/// A motion between equal poses with so many inliers, the first of which are far points.
TrackingResult foundOf(int num_inliers, int num_far = 0) {
  TrackingResult tracked;
  tracked.correspondences.points.resize(static_cast<std::size_t>(num_inliers));
  for (int i = 0; i < num_far; ++i) tracked.correspondences.points[i].far = true;
  tracked.frame_to_frame.status = MotionStatus::kOk;
  tracked.frame_to_frame.point_inliers.assign(static_cast<std::size_t>(num_inliers), true);
  tracked.frame_to_frame.num_point_inliers = num_inliers;
  return tracked;
}

/// A tenth may seem to be found at a wrong motion: 40 of 400 with a standard deviation of 6.
TEST(MotionConfirmation, FewOfManyFeaturesAreFoundByChance) {
  const StereoFrame frame = frameOf(400);
  EXPECT_TRUE(isByChance(frame, kCamera, foundOf(30)));
  EXPECT_TRUE(isByChance(frame, kCamera, foundOf(52)));
  EXPECT_FALSE(isByChance(frame, kCamera, foundOf(53)));
}

/// Of 20 features five are more than chance finds, though as many of 400 are not.
TEST(MotionConfirmation, WhatIsFoundByChanceDependsOnWhatIsInView) {
  EXPECT_TRUE(isByChance(frameOf(20), kCamera, foundOf(4)));
  EXPECT_FALSE(isByChance(frameOf(20), kCamera, foundOf(5)));

  TrackingResult turned = foundOf(5);
  turned.frame_to_frame.T_curr_prev.linear() =
      Eigen::AngleAxisd(0.5 * M_PI, Eigen::Vector3d::UnitY()).toRotationMatrix();
  EXPECT_FALSE(isByChance(frameOf(400), kCamera, turned)) << "nothing of the frame is in view";
}

TEST(MotionConfirmation, OutliersAreMatchesThatDisagree) {
  TrackingResult tracked = foundOf(60, 20);
  EXPECT_EQ(shareAgreeing(tracked), 1.0);
  tracked.correspondences.points.resize(70);
  tracked.correspondences.lines.resize(10);
  EXPECT_EQ(shareAgreeing(tracked), 0.75);
  tracked.frame_to_frame.num_line_inliers = 8;
  EXPECT_EQ(shareAgreeing(tracked), 0.85);
  EXPECT_EQ(shareAgreeing(TrackingResult()), 0.0);
}

/// On top of a hill, where the motion has no translation of the images.
TEST(MotionConfirmation, FarPointsDoNotAgreeByChance) {
  EXPECT_TRUE(isByChance(frameOf(400), kCamera, foundOf(60, 30)));
  EXPECT_FALSE(isByChance(frameOf(400), kCamera, foundOf(60, 31)));
}

/// What may be the motion of something else predicts no pixels, and keeps no pose of a camera at
/// rest.
TEST(OdometryPose, AnAmbiguousMotionSaysNothingOfTheNextFrame) {
  const cv::Mat image(kCamera.height, kCamera.width, CV_8UC1, cv::Scalar(0));
  const StereoCorrection correction;
  const Parameters parameters;
  for (const bool ambiguous : {false, true}) {
    OdometryPose pose{Eigen::Isometry3d::Identity()};
    FrameHistory history;
    history.previous.emplace();
    TrackingResult tracked = foundOf(100);
    tracked.motion = tracked.frame_to_frame;
    tracked.motion.covariance = tracked.frame_to_frame.covariance = 1e-6 * Matrix6d::Identity();
    tracked.ambiguous = ambiguous;
    for (int k = 1; k <= 10; ++k) {
      const StereoImages images{image, image, 100000000LL * k};
      const FrameContext context{images, kCamera, correction, parameters};
      EXPECT_EQ(pose.update(tracked, history, context, 0.1, nullptr),
                ambiguous ? TrackingState::kDegraded : TrackingState::kOk);
      history.previous->stamp_ns = images.stamp_ns;
      pose.advance();
    }
    ASSERT_TRUE(pose.velocity());
    EXPECT_EQ(pose.velocity()->is_current, !ambiguous);
    EXPECT_EQ(pose.isStationary(), !ambiguous);
  }
}

TEST(MotionConfirmation, NoMotionIsNotOneByChance) {
  EXPECT_FALSE(isByChance(frameOf(400), kCamera, TrackingResult()));
}

}  // namespace
}  // namespace point_line_odometry
