/// What moves between two frames, and the motion that explains it.

#include "odometry/moving_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "geometry/se3.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

class MovingSceneTest : public ::testing::Test {
 protected:
  /// A point that moves by a motion, and by noise in each image.
  MatchedPoint match(const Isometry3d& T_curr_prev, double noise_px) {
    MatchedPoint match{0, {}, 0.0};
    match.point.p_prev = synthetic::visiblePoint(camera_, &random_);
    const Vector3d p_curr = T_curr_prev * match.point.p_prev;
    const Vector2d noise(random_.normal(noise_px), random_.normal(noise_px));
    match.point.left_px = camera_.projectLeft(p_curr) + noise;
    match.point.right_px = camera_.projectRight(p_curr) + noise;
    match.shift_px = (match.point.left_px - camera_.projectLeft(match.point.p_prev)).norm();
    return match;
  }

  std::vector<MatchedPoint> matches(int count, const Isometry3d& T_curr_prev, double noise_px) {
    std::vector<MatchedPoint> list;
    for (int i = 0; i < count; ++i) list.push_back(match(T_curr_prev, noise_px));
    return list;
  }

  const StereoCamera camera_ = synthetic::camera();
  const Isometry3d kSlow = synthetic::transform({0.003, 0.001, 0.0}, {0.004, 0.0, -0.01});
  synthetic::Random random_{1};
  const StereoImages images_{cv::Mat(camera_.height, camera_.width, CV_8UC1, cv::Scalar(0)),
                             cv::Mat(camera_.height, camera_.width, CV_8UC1, cv::Scalar(0)), 0};
  const StereoCorrection correction_;
  const Parameters parameters_;
  const FrameContext context_{images_, camera_, correction_, parameters_};
};

/// Of what rests, detection moves some points by a pixel.
TEST_F(MovingSceneTest, TheMotionOfWhatMovesIsFoundBesideWhatRests) {
  std::vector<MatchedPoint> all = matches(60, kSlow, 0.3);
  const std::vector<MatchedPoint> resting = matches(120, Isometry3d::Identity(), 0.5);
  all.insert(all.end(), resting.begin(), resting.end());
  const auto scene = findMovingScene(all, 1.0, context_);
  ASSERT_TRUE(scene);
  EXPECT_LT(poseDifference(scene->T_curr_prev, kSlow).tail<3>().norm(), 1e-3);
  EXPECT_GT(scene->depths.size(), 50U);
  EXPECT_LT(scene->depths.size(), 75U) << "points that noise moves are not explained";
}

TEST_F(MovingSceneTest, NoMotionExplainsNoise) {
  for (int k = 0; k < 20; ++k)
    EXPECT_FALSE(findMovingScene(matches(100, Isometry3d::Identity(), 1.5), 1.0, context_)) << k;
}

TEST_F(MovingSceneTest, AFewPointsAreNoScene) {
  EXPECT_TRUE(findMovingScene(matches(16, kSlow, 0.1), 1.0, context_));
  EXPECT_FALSE(findMovingScene(matches(7, kSlow, 0.1), 1.0, context_));
  EXPECT_FALSE(findMovingScene({}, 1.0, context_));
}

/// Most of what moves does so by itself: it is no scene in which the camera moves.
TEST_F(MovingSceneTest, AMinorityIsNoScene) {
  std::vector<MatchedPoint> all = matches(20, kSlow, 0.1);
  for (int i = 0; i < 80; ++i) {
    const Isometry3d own = synthetic::transform(
        Vector3d::Zero(), {random_.uniform(-1.0, 1.0), random_.uniform(-1.0, 1.0), 0.0});
    all.push_back(match(own, 0.0));
  }
  EXPECT_FALSE(findMovingScene(all, 1.0, context_));
}

TEST_F(MovingSceneTest, FarPointsAreMovedByARotationAlone) {
  StereoFrame frame;
  frame.features.points_left.resize(1);
  StereoPoint point;
  point.left = 0;
  point.triangulated.p_camera = {0.0, 0.0, 4.0};
  const Isometry3d rest = Isometry3d::Identity();
  const Isometry3d aside = synthetic::transform(Vector3d::Zero(), {0.02, 0.0, 0.0});
  const Isometry3d turned = synthetic::transform({0.0, 0.01, 0.0}, Vector3d::Zero());
  const Isometry3d behind = synthetic::transform(Vector3d::Zero(), {0.0, 0.0, -5.0});
  EXPECT_NEAR(shiftBetween(frame, point, aside, rest, context_), 0.02 * camera_.fx / 4.0, 1e-9);
  EXPECT_NEAR(shiftBetween(frame, point, aside, aside, context_), 0.0, 1e-9);
  EXPECT_TRUE(std::isinf(shiftBetween(frame, point, behind, rest, context_)));
  point.far = true;
  EXPECT_NEAR(shiftBetween(frame, point, aside, rest, context_), 0.0, 1e-9);
  EXPECT_NEAR(shiftBetween(frame, point, turned, rest, context_), std::tan(0.01) * camera_.fx,
              1e-6);
}

/// At the pixels to which they were aligned, without far points and outliers.
TEST_F(MovingSceneTest, InliersMoveByTheirAlignedPixels) {
  StereoFrame prev;
  TrackingResult tracked;
  for (int i = 0; i < 4; ++i) {
    StereoPoint point;
    point.left = i;
    point.triangulated.p_camera = synthetic::visiblePoint(camera_, &random_);
    point.far = i == 2;
    Keypoint keypoint;
    keypoint.pixel = {10.0F, 10.0F};  // as far off as no detection
    prev.features.points_left.push_back(keypoint);
    prev.points.push_back(point);
    tracked.matches.points.push_back({i, i});
    PointCorrespondence aligned;
    aligned.p_prev = point.triangulated.p_camera;
    aligned.left_px = camera_.projectLeft(aligned.p_prev) + Vector2d(3.0, 4.0);
    tracked.correspondences.points.push_back(aligned);
  }
  EXPECT_TRUE(matchedInliers(tracked, prev, context_).empty()) << "without a motion";
  tracked.frame_to_frame.status = MotionStatus::kOk;
  tracked.frame_to_frame.point_inliers = {true, false, true, true};
  const std::vector<MatchedPoint> inliers = matchedInliers(tracked, prev, context_);
  ASSERT_EQ(inliers.size(), 2U);
  EXPECT_EQ(inliers[0].prev, 0);
  EXPECT_EQ(inliers[1].prev, 3);
  for (const MatchedPoint& inlier : inliers) EXPECT_NEAR(inlier.shift_px, 5.0, 1e-9);
}

}  // namespace
}  // namespace point_line_odometry
