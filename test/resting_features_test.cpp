/// Features that rest on the robot's own body, in frames of points with known positions.

#include "odometry/resting_features.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <optional>
#include <random>
#include <vector>

#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

const StereoCamera kCamera = synthetic::roomCamera();

struct WorldPoint {
  Vector3d position;  ///< in the first camera [m]
  Descriptor left{};
  Descriptor right{};
};

/// Points between two depths, in a part of the image.
std::vector<WorldPoint> makePoints(int count, double nearest, double farthest, double first_row,
                                   double last_row, unsigned seed) {
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11U) * 0x1p-53;
  };
  std::vector<WorldPoint> points;
  for (int i = 0; i < count; ++i) {
    WorldPoint point;
    const double depth = uniform(nearest, farthest);
    const double u = uniform(0.25, 0.95) * kCamera.width;
    const double v = uniform(first_row, last_row) * kCamera.height;
    point.position =
        depth * Vector3d((u - kCamera.cx) / kCamera.fx, (v - kCamera.cy) / kCamera.fy, 1.0);
    for (std::uint64_t& bits : point.left) bits = random();
    for (std::uint64_t& bits : point.right) bits = random();
    points.push_back(point);
  }
  return points;
}

/// As many points of each as there are where the body hides a third of the image.
class RestingFeaturesTest : public ::testing::Test {
 protected:
  /// Points of the body come first. \param T_camera_world of the scene, \param T_camera_body of
  /// what rests usually.
  StereoFrame frameAt(const Isometry3d& T_camera_world,
                      const Isometry3d& T_camera_body = Isometry3d::Identity()) const {
    StereoFrame frame;
    for (const WorldPoint& point : body_) append(point, T_camera_body, &frame);
    for (const WorldPoint& point : scene_) append(point, T_camera_world, &frame);
    return frame;
  }

  static void append(const WorldPoint& point, const Isometry3d& T, StereoFrame* frame) {
    const Vector3d p = T * point.position;
    const Eigen::Vector2f left_px = kCamera.projectLeft(p).cast<float>();
    const bool in_view = left_px.x() >= 0.0F && left_px.y() >= 0.0F &&
                         left_px.x() < static_cast<float>(kCamera.width) &&
                         left_px.y() < static_cast<float>(kCamera.height);
    if (!in_view) return;
    StereoPoint stereo;
    stereo.left = static_cast<int>(frame->features.points_left.size());
    stereo.right = stereo.left;
    stereo.right_px = kCamera.projectRight(p).cast<float>();
    stereo.triangulated.p_camera = p;
    frame->points.push_back(stereo);
    Keypoint keypoint;
    keypoint.pixel = left_px;
    keypoint.descriptor = point.left;
    frame->features.points_left.push_back(keypoint);
    keypoint.pixel = stereo.right_px;
    keypoint.descriptor = point.right;
    frame->features.points_right.push_back(keypoint);
  }

  std::optional<RestingBody> find(const RestingFeatures& resting, const StereoFrame& prev,
                                  const StereoFrame& curr) const {
    TrackingResult failed;
    failed.frame_to_frame.status = MotionStatus::kTooFewInliers;
    return resting.findBeforeScene(prev, curr, failed, context_);
  }

  /// Of a point that both frames have at the same index.
  static PointCorrespondence correspondence(const StereoFrame& prev, const StereoFrame& curr,
                                            int i) {
    PointCorrespondence point;
    point.p_prev = prev.points[i].triangulated.p_camera;
    point.left_px = kCamera.projectLeft(curr.points[i].triangulated.p_camera);
    point.right_px = kCamera.projectRight(curr.points[i].triangulated.p_camera);
    return point;
  }

  /// The motion `T_curr_prev` with these points of both frames as its inliers.
  static TrackingResult moved(const StereoFrame& prev, const StereoFrame& curr,
                              const Isometry3d& T_curr_prev, const std::vector<int>& inliers) {
    TrackingResult tracked;
    for (const int i : inliers) {
      tracked.matches.points.push_back({i, i});
      tracked.correspondences.points.push_back(correspondence(prev, curr, i));
    }
    tracked.frame_to_frame.status = MotionStatus::kOk;
    tracked.frame_to_frame.T_curr_prev = T_curr_prev;
    tracked.frame_to_frame.point_inliers.assign(inliers.size(), true);
    tracked.frame_to_frame.num_point_inliers = static_cast<int>(inliers.size());
    EXPECT_LT(inliers.size(), prev.points.size());
    return tracked;
  }

  /// Between equal poses, where these points of the previous frame were found again where they
  /// were.
  static TrackingResult atRest(const StereoFrame& prev, const std::vector<int>& found) {
    return moved(prev, prev, Isometry3d::Identity(), found);
  }

  /// Every n-th index from begin to end.
  static std::vector<int> indices(std::size_t begin, std::size_t end, std::size_t every = 1) {
    std::vector<int> list;
    for (std::size_t i = begin; i < end; i += every) list.push_back(static_cast<int>(i));
    return list;
  }

  /// Whether what is found of a body before a scene is enough.
  /// Each time as of a new frame.
  bool confirm(const StereoFrame& prev, StereoFrame curr, RestingFeatures* resting) {
    curr.stamp_ns = ++stamp_ns_;
    return confirmAgain(prev, curr, resting);
  }

  bool confirmAgain(const StereoFrame& prev, const StereoFrame& curr,
                    RestingFeatures* resting) const {
    return resting->confirm(find(*resting, prev, curr), prev, curr, context_);
  }

  /// A frame with these of the scene's points only.
  StereoFrame withScene(std::size_t count, const Isometry3d& T_camera_world) const {
    StereoFrame frame;
    for (const WorldPoint& point : body_) append(point, Isometry3d::Identity(), &frame);
    for (std::size_t i = 0; i < count; ++i) append(scene_[i], T_camera_world, &frame);
    return frame;
  }

  /// What is left of the body in a frame, without its resting features.
  std::ptrdiff_t numLeftOfBody(const RestingFeatures& resting, StereoFrame frame) const {
    resting.leaveOut(&frame);
    return std::count_if(frame.points.begin(), frame.points.end(), [&](const StereoPoint& point) {
      return point.left < static_cast<int>(body_.size());
    });
  }

  /// What is left of a frame, without its resting features.
  static std::size_t numLeft(const RestingFeatures& resting, StereoFrame frame) {
    resting.leaveOut(&frame);
    return frame.points.size();
  }

  void drive(int frames, const Isometry3d& T_body, RestingFeatures* resting) const {
    TrackingResult tracked;
    tracked.motion.T_curr_prev = kStep;
    for (int k = 0; k < frames; ++k)
      resting->learn(frameAt(Isometry3d::Identity()), frameAt(kStep, T_body), tracked, context_);
  }

  const std::vector<WorldPoint> body_ = makePoints(120, 0.8, 1.4, 0.7, 0.95, 1);
  const std::vector<WorldPoint> scene_ = makePoints(200, 3.0, 9.0, 0.05, 0.6, 2);
  const Isometry3d kStep = synthetic::transform({0.0, 0.02, 0.0}, {0.05, 0.0, -0.2});
  const StereoImages images_{cv::Mat(kCamera.height, kCamera.width, CV_8UC1, cv::Scalar(0)),
                             cv::Mat(kCamera.height, kCamera.width, CV_8UC1, cv::Scalar(0)), 0};
  std::int64_t stamp_ns_ = 0;
  const StereoCorrection correction_;
  const Parameters parameters_;
  const FrameContext context_{images_, kCamera, correction_, parameters_};
};

TEST_F(RestingFeaturesTest, TheBodyIsFoundBeforeAMovingScene) {
  const RestingFeatures resting(kCamera);
  const auto found = find(resting, frameAt(Isometry3d::Identity()), frameAt(kStep));
  ASSERT_TRUE(found);
  ASSERT_EQ(found->points.size(), body_.size());
  for (std::size_t i = 0; i < body_.size(); ++i) EXPECT_EQ(found->points[i], static_cast<int>(i));
  EXPECT_TRUE(found->T_curr_prev.isApprox(kStep, 1e-3));
  EXPECT_GT(found->num_scene, 100);
}

/// A robot that starts off slowly: the scene moves by two pixels.
TEST_F(RestingFeaturesTest, TheBodyIsFoundBeforeASceneThatMovesSlowly) {
  const Isometry3d slow = synthetic::transform({2.05 / kCamera.fy, 0.0, 0.0}, Vector3d::Zero());
  const StereoFrame prev = frameAt(Isometry3d::Identity());
  RestingFeatures resting(kCamera);
  const auto found = find(resting, prev, frameAt(slow));
  ASSERT_TRUE(found);
  EXPECT_EQ(found->points.size(), body_.size());
  ASSERT_TRUE(confirm(prev, frameAt(slow), &resting));
  EXPECT_EQ(numLeftOfBody(resting, prev), 0);
  EXPECT_FALSE(find(RestingFeatures(kCamera), prev, frameAt(slow, slow))) << "the camera moves";
}

/// A motion between rest and the scene's has the inliers of both where they differ by two pixels.
TEST_F(RestingFeaturesTest, TheBodyIsFoundWhereTheMotionIsACompromise) {
  const Isometry3d slow = synthetic::transform({2.05 / kCamera.fy, 0.0, 0.0}, Vector3d::Zero());
  const Isometry3d half = synthetic::transform({1.0 / kCamera.fy, 0.0, 0.0}, Vector3d::Zero());
  const StereoFrame prev = frameAt(Isometry3d::Identity());
  const StereoFrame curr = frameAt(slow);
  const RestingFeatures resting(kCamera);
  std::vector<int> inliers = indices(0, body_.size());
  const std::vector<int> of_scene = indices(body_.size(), prev.points.size(), 4);
  inliers.insert(inliers.end(), of_scene.begin(), of_scene.end());
  const auto found =
      resting.findBeforeScene(prev, curr, moved(prev, curr, half, inliers), context_);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->points.size(), body_.size());
  EXPECT_TRUE(found->T_curr_prev.isApprox(slow, 1e-3));
}

/// It is left out already, or its features are outliers: nothing is in the way.
TEST_F(RestingFeaturesTest, NothingHoldsTheMotionOfTheScene) {
  const StereoFrame prev = frameAt(Isometry3d::Identity());
  const StereoFrame curr = frameAt(kStep);
  std::vector<int> inliers = indices(body_.size(), prev.points.size());
  const std::vector<int> some = indices(0, body_.size(), 2);
  inliers.insert(inliers.end(), some.begin(), some.end());
  const RestingFeatures resting(kCamera);
  EXPECT_FALSE(resting.findBeforeScene(prev, curr, moved(prev, curr, kStep, inliers), context_));
}

/// Noise moves points, of which no motion explains the way.
TEST_F(RestingFeaturesTest, NoSceneIsFoundInNoise) {
  const StereoFrame prev = frameAt(Isometry3d::Identity());
  const RestingFeatures resting(kCamera);
  for (unsigned seed = 0; seed < 20; ++seed) {
    std::mt19937 random(seed);
    const auto noise = [&] { return 2.0F * (static_cast<float>(random()) * 0x1p-31F - 1.0F); };
    StereoFrame curr = prev;
    for (std::size_t i = body_.size(); i < curr.points.size(); ++i) {
      const Eigen::Vector2f shift(noise(), noise());
      curr.features.points_left[i].pixel += shift;
      curr.points[i].right_px += shift;
    }
    EXPECT_FALSE(find(resting, prev, curr)) << seed;
  }
}

/// A robot that stands in the dark finds up to three quarters of what it sees.
TEST_F(RestingFeaturesTest, ACameraThatFindsMostIsNotDoubted) {
  const RestingFeatures resting(kCamera);
  const StereoFrame frame = frameAt(Isometry3d::Identity());
  std::vector<int> found = indices(0, body_.size());
  const std::vector<int> of_scene = indices(body_.size(), body_.size() + 110);
  found.insert(found.end(), of_scene.begin(), of_scene.end());
  ASSERT_GT(static_cast<double>(found.size()), 0.65 * static_cast<double>(frame.points.size()));
  EXPECT_FALSE(resting.mayHideScene(frame, atRest(frame, found), context_));
}

/// In the dark, a frame shows few points of the scene.
TEST_F(RestingFeaturesTest, FewPointsOfTheSceneAreEnoughInFramesOneAfterTheOther) {
  RestingFeatures resting(kCamera);
  const StereoFrame prev = withScene(12, Isometry3d::Identity());
  const StereoFrame curr = withScene(12, kStep);
  EXPECT_FALSE(confirm(prev, curr, &resting));
  EXPECT_EQ(numLeft(resting, prev), prev.points.size());
  ASSERT_TRUE(confirm(prev, curr, &resting));
  EXPECT_EQ(numLeftOfBody(resting, prev), 0);

  RestingFeatures interrupted(kCamera);
  EXPECT_FALSE(confirm(prev, curr, &interrupted));
  for (int k = 0; k < 3; ++k) EXPECT_FALSE(confirm(prev, prev, &interrupted));
  EXPECT_FALSE(confirm(prev, curr, &interrupted));

  RestingFeatures tracked_twice(kCamera);
  EXPECT_FALSE(confirm(prev, curr, &tracked_twice));
  StereoFrame same = curr;
  same.stamp_ns = stamp_ns_;
  EXPECT_FALSE(confirmAgain(prev, same, &tracked_twice)) << "no further evidence";
  StereoFrame all = frameAt(kStep);
  all.stamp_ns = stamp_ns_;
  EXPECT_TRUE(confirmAgain(frameAt(Isometry3d::Identity()), all, &tracked_twice)) << "more of it";
}

/// In the dark, most points of a body are noise that is not found again.
TEST_F(RestingFeaturesTest, ABodyOfWhichLittleIsFoundAgainRestsOnceItIsFound) {
  const auto leftAfter = [&](bool confirmed) {
    RestingFeatures resting(kCamera);
    const StereoFrame frame = frameAt(Isometry3d::Identity());
    if (confirmed) {
      EXPECT_TRUE(confirm(frame, frameAt(kStep), &resting));
    }
    TrackingResult tracked;
    tracked.motion.T_curr_prev = tracked.frame_to_frame.T_curr_prev = kStep;
    tracked.frame_to_frame.status = MotionStatus::kOk;
    tracked.frame_to_frame.num_point_inliers = 80;
    for (std::size_t k = 0; k < 60; ++k) {
      StereoFrame dark = frameAt(kStep);
      for (std::size_t i = 0; i < body_.size(); ++i) {
        if (i % 10 != k % 10) dark.features.points_left[i].descriptor = {};
      }
      resting.learn(frame, dark, tracked, context_);
    }
    return numLeftOfBody(resting, frame);
  };
  const auto size = static_cast<std::ptrdiff_t>(body_.size());
  EXPECT_GT(leftAfter(false), size / 2);
  EXPECT_LT(leftAfter(true), size / 20);
}

TEST_F(RestingFeaturesTest, NothingIsFoundWhereAllRestsOrAllMoves) {
  const RestingFeatures resting(kCamera);
  const StereoFrame first = frameAt(Isometry3d::Identity());
  EXPECT_FALSE(find(resting, first, first));
  EXPECT_FALSE(find(resting, first, frameAt(kStep, kStep)));
}

/// Before a stationary camera something near passes, and what is behind it rests.
TEST_F(RestingFeaturesTest, WhatRestsBehindSomethingMovingIsTheScene) {
  const RestingFeatures resting(kCamera);
  const StereoFrame first = frameAt(Isometry3d::Identity());
  EXPECT_FALSE(find(resting, first, frameAt(Isometry3d::Identity(), kStep)));
}

/// Nothing of the scene is found again: it moves too fast, or shows too little.
TEST_F(RestingFeaturesTest, WhatRestsMayHideASceneThatIsNotFoundAgain) {
  const StereoFrame frame = frameAt(Isometry3d::Identity());
  const TrackingResult body_found = atRest(frame, indices(0, body_.size()));
  RestingFeatures resting(kCamera);
  EXPECT_TRUE(resting.mayHideScene(frame, body_found, context_));
  drive(3, kStep, &resting);
  EXPECT_FALSE(resting.mayHideScene(frame, body_found, context_)) << "it moved before";
}

TEST_F(RestingFeaturesTest, ACameraAtRestFindsSomeOfAllThatItSees) {
  const RestingFeatures resting(kCamera);
  const StereoFrame frame = frameAt(Isometry3d::Identity());
  for (const std::size_t every : {2, 3, 6}) {
    const TrackingResult dark = atRest(frame, indices(0, frame.points.size(), every));
    EXPECT_FALSE(resting.mayHideScene(frame, dark, context_)) << every;
  }
}

/// Somebody stands before the camera; or what rests is before the sea, and no part of the robot.
TEST_F(RestingFeaturesTest, WhatIsNotNearestOrFarAwayHidesNoScene) {
  const RestingFeatures resting(kCamera);
  const StereoFrame frame = frameAt(Isometry3d::Identity());
  const TrackingResult scene_found = atRest(frame, indices(body_.size(), frame.points.size()));
  EXPECT_FALSE(resting.mayHideScene(frame, scene_found, context_));

  StereoFrame shore = frame;
  for (StereoPoint& point : shore.points) point.triangulated.p_camera *= 4.0;
  const TrackingResult shore_found = atRest(shore, indices(0, body_.size()));
  EXPECT_FALSE(resting.mayHideScene(shore, shore_found, context_));
}

TEST_F(RestingFeaturesTest, WhatRestsInMotionIsLeftOut) {
  RestingFeatures resting(kCamera);
  const StereoFrame frame = frameAt(Isometry3d::Identity());
  EXPECT_EQ(numLeft(resting, frame), body_.size() + scene_.size());
  drive(3, Isometry3d::Identity(), &resting);
  StereoFrame left = frame;
  resting.leaveOut(&left);
  EXPECT_EQ(left.points.size(), scene_.size());
  EXPECT_EQ(left.resting_points.size(), body_.size());

  LineFeature on_body;
  on_body.segment = {{300.0F, 0.8F * static_cast<float>(kCamera.height)},
                     {400.0F, 0.9F * static_cast<float>(kCamera.height)}};
  LineFeature in_scene = on_body;
  in_scene.segment.start.y() = in_scene.segment.end.y() = 0.3F * static_cast<float>(kCamera.height);
  left.features.lines_left = {on_body, in_scene};
  left.lines.resize(2);
  left.lines[0].left = 0;
  left.lines[1].left = 1;
  resting.leaveOut(&left);
  ASSERT_EQ(left.lines.size(), 1U);
  EXPECT_EQ(left.lines[0].left, 1);
}

/// A car ahead that keeps its distance, and then drives off.
TEST_F(RestingFeaturesTest, WhatMovesAgainIsUsedAgain) {
  RestingFeatures resting(kCamera);
  drive(3, Isometry3d::Identity(), &resting);
  drive(20, kStep, &resting);
  const StereoFrame frame = frameAt(Isometry3d::Identity());
  EXPECT_EQ(numLeft(resting, frame), frame.points.size());
}

/// Where the scene was seen to move it can rest with the camera only.
TEST_F(RestingFeaturesTest, ASceneThatMovedBeforeIsNoBody) {
  RestingFeatures resting(kCamera);
  drive(3, kStep, &resting);
  EXPECT_FALSE(find(resting, frameAt(Isometry3d::Identity()), frameAt(kStep)));
}

TEST_F(RestingFeaturesTest, AllIsForgottenAfterALongLoss) {
  RestingFeatures resting(kCamera);
  const StereoFrame frame = frameAt(Isometry3d::Identity());
  ASSERT_TRUE(confirm(frame, frameAt(kStep), &resting));
  EXPECT_EQ(numLeftOfBody(resting, frame), 0);
  EXPECT_GT(numLeft(resting, frame), scene_.size() / 2);
  for (int k = 0; k < 90; ++k) resting.addLost(0.1);
  EXPECT_EQ(numLeftOfBody(resting, frame), 0);
  for (int k = 0; k < 20; ++k) resting.addLost(0.1);
  EXPECT_EQ(numLeft(resting, frame), frame.points.size());
}

}  // namespace
}  // namespace point_line_odometry
