/// When patches have to be aligned again: where the motion found warps them otherwise.

#include "odometry/correspondences.h"

#include <gtest/gtest.h>

#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using synthetic::transform;

const StereoCamera kCamera = synthetic::roomCamera();
constexpr std::size_t kPoints = 40;

/// Points at depths of 4.1 to 8 m, all matched.
class WarpsTest : public ::testing::Test {
 protected:
  WarpsTest() {
    for (int i = 0; i < static_cast<int>(kPoints); ++i) {
      StereoPoint point;
      const double z = 4.0 + 0.1 * (i + 1);
      point.triangulated.p_camera = {0.1 * (i % 8 - 4) * z, 0.05 * (i % 5 - 2) * z, z};
      earlier_.points.push_back(point);
      matches_.points.push_back({i, i});
    }
    motion_.status = MotionStatus::kOk;
    motion_.point_inliers.assign(kPoints, true);
    motion_.num_point_inliers = kPoints;
  }

  /// \param T_predicted by which the patches were warped.
  bool differAt(const Isometry3d& T_curr_prev,
                const Isometry3d& T_predicted = Isometry3d::Identity()) {
    motion_.T_curr_prev = T_curr_prev;
    return warpsDiffer(earlier_, matches_, motion_, T_predicted, kCamera);
  }

  /// Of points that are near, the others being ten times as far.
  void setNear(int num_near, bool are_inliers) {
    motion_.num_point_inliers = 0;
    for (std::size_t i = 0; i < kPoints; ++i) {
      const bool is_near = static_cast<int>(i) < num_near;
      if (!is_near) earlier_.points[i].triangulated.p_camera *= 10.0;
      motion_.point_inliers[i] = !is_near || are_inliers;
      motion_.num_point_inliers += motion_.point_inliers[i] ? 1 : 0;
    }
  }

  StereoFrame earlier_;
  CircularMatches matches_;
  MotionEstimate motion_;
};

const Isometry3d kForward = transform(Vector3d::Zero(), {0.0, 0.0, -0.3});

TEST_F(WarpsTest, DoNotDifferAtTheSameMotion) {
  EXPECT_FALSE(differAt(Isometry3d::Identity()));
  const Isometry3d turned = transform({0.0, 0.05, 0.3}, {0.1, 0.0, -0.3});
  EXPECT_FALSE(differAt(turned, turned));
  EXPECT_TRUE(differAt(Isometry3d::Identity(), turned));
}

/// 2 % of 4.1 to 8 m are 0.08 to 0.16 m; of a tenth of the points, 0.09 m.
TEST_F(WarpsTest, DifferWithScaleAndRoll) {
  EXPECT_FALSE(differAt(transform(Vector3d::Zero(), {0.0, 0.0, -0.07})));
  EXPECT_TRUE(differAt(transform(Vector3d::Zero(), {0.0, 0.0, -0.11})));
  EXPECT_TRUE(differAt(transform(Vector3d::Zero(), {0.0, 0.0, 0.11})));
  EXPECT_FALSE(differAt(transform({0.0, 0.0, 0.018}, Vector3d::Zero())));
  EXPECT_TRUE(differAt(transform({0.0, 0.0, 0.022}, Vector3d::Zero())));
}

TEST_F(WarpsTest, DoNotDifferBesideWhereTheyWere) {
  EXPECT_FALSE(differAt(transform(Vector3d::Zero(), {0.3, 0.3, 0.0})));
}

/// A plane that is seen at a grazing angle is sheared by a motion aside.
TEST_F(WarpsTest, DifferByTheShearOfASlantedPlane) {
  for (StereoPoint& point : earlier_.points) point.slope = {0.0F, -0.2F};
  EXPECT_TRUE(differAt(transform(Vector3d::Zero(), {0.3, 0.0, 0.0})));
}

TEST_F(WarpsTest, DifferWhereAQuarterIsNear) {
  setNear(10, true);
  EXPECT_TRUE(differAt(kForward));
}

TEST_F(WarpsTest, OfOutliersDoNotCount) {
  setNear(10, false);
  EXPECT_FALSE(differAt(kForward));
}

TEST_F(WarpsTest, OfFewDoNotCount) {
  setNear(3, true);
  EXPECT_FALSE(differAt(kForward)) << "three of 40";
}

/// Patches that could not be warped before were taken as they are.
TEST_F(WarpsTest, OfPointsThatWerePredictedBehindTheCamera) {
  EXPECT_TRUE(differAt(kForward, transform(Vector3d::Zero(), {0.0, 0.0, -20.0})));
  EXPECT_FALSE(differAt(Isometry3d::Identity(), transform(Vector3d::Zero(), {0.0, 0.0, -20.0})));
}

TEST_F(WarpsTest, OfNoInliersDoNotDiffer) {
  motion_.point_inliers.assign(kPoints, false);
  motion_.num_point_inliers = 0;
  EXPECT_FALSE(differAt(kForward));
}

}  // namespace
}  // namespace point_line_odometry
