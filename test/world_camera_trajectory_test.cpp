#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "world/camera_trajectory.h"
#include "world/corridor.h"
#include "world/indoor.h"
#include "world/plaster.h"
#include "world/scene.h"
#include "world/street.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Vector3d;

MotionStyle style() {
  MotionStyle style;
  style.cruise_m_s = 10.0;
  style.lateral_m_s2 = 2.5;
  style.longitudinal_m_s2 = 1.5;
  style.sway_m = {0.01, 0.02, 0.03};
  style.sway_rad = {0.01, 0.01, 0.01};
  return style;
}

CameraTrajectory square() {
  return CameraTrajectory({{0, 0, 2}, {100, 0, 2}, {100, 80, 2}, {0, 80, 2}}, 12.0, style(), 1);
}

double speedAt(const CameraTrajectory& trajectory, double time_s) {
  constexpr double kStep = 1e-3;
  return (trajectory.travelled_m(time_s + kStep, 1.0) -
          trajectory.travelled_m(time_s - kStep, 1.0)) /
         (2.0 * kStep);
}

TEST(CameraTrajectory, IsClosedAndAboutAsLongAsThePolygon) {
  const CameraTrajectory trajectory = square();
  EXPECT_LT(trajectory.length_m(), 360.0);
  EXPECT_GT(trajectory.length_m(), 330.0);
  EXPECT_TRUE(trajectory.at(0.0).isApprox(trajectory.at(trajectory.length_m()), 1e-6));
}

TEST(CameraTrajectory, BeginsOnTheFirstEdgeAndLooksAlongIt) {
  const CameraTrajectory trajectory = square();
  const Eigen::Isometry3d pose = trajectory.at(0.0);
  EXPECT_NEAR(pose.translation().y(), 0.0, 1e-6);
  EXPECT_NEAR(pose.linear()(0, 0), 1.0, 1e-6);
  const Eigen::Isometry3d camera = trajectory.cameraPose(0.0, 1.0, 0.0);
  EXPECT_TRUE(camera.linear().col(2).isApprox(Vector3d::UnitX(), 1e-6));   // forward
  EXPECT_TRUE(camera.linear().col(1).isApprox(-Vector3d::UnitZ(), 1e-6));  // down
}

TEST(CameraTrajectory, ArcLengthIsTheLengthTravelled) {
  const CameraTrajectory trajectory = square();
  for (double arc = 0.0; arc < 700.0; arc += 1.7) {
    const double step =
        (trajectory.at(arc + 0.1).translation() - trajectory.at(arc).translation()).norm();
    ASSERT_NEAR(step, 0.1, 1e-3) << arc;
  }
}

TEST(CameraTrajectory, SpeedAndItsChangeAreBounded) {
  const CameraTrajectory trajectory = square();
  double slowest = 1e9;
  double fastest = 0.0;
  for (double t = 0.01; t < 60.0; t += 0.05) {
    const double speed = speedAt(trajectory, t);
    slowest = std::min(slowest, speed);
    fastest = std::max(fastest, speed);
    ASSERT_LT(std::abs(speedAt(trajectory, t + 0.05) - speed), 1.1 * 0.05 * 1.5) << t;
  }
  EXPECT_LT(slowest, 7.0);  // in the curves
  EXPECT_GT(slowest, 2.0);
  EXPECT_NEAR(fastest, 10.0, 0.01);
}

TEST(CameraTrajectory, CurvesAreDrivenAtTheLateralAcceleration) {
  const CameraTrajectory trajectory = square();
  for (double t = 0.5; t < 60.0; t += 0.1) {
    const double speed = speedAt(trajectory, t);
    constexpr double kStep = 0.02;
    const auto heading = [&](double time) {
      return Vector3d(trajectory.at(trajectory.travelled_m(time, 1.0)).linear().col(0));
    };
    const double turn_rate = (heading(t + kStep) - heading(t - kStep)).norm() / (2.0 * kStep);
    ASSERT_LT(speed * turn_rate, 1.1 * 2.5) << t;
  }
}

TEST(CameraTrajectory, SpeedFactorStretchesTime) {
  const CameraTrajectory trajectory = square();
  EXPECT_NEAR(trajectory.travelled_m(10.0, 2.0), trajectory.travelled_m(20.0, 1.0), 1e-9);
  EXPECT_EQ(trajectory.travelled_m(10.0, 0.0), 0.0);
}

TEST(CameraTrajectory, SwayIsSmoothAndScales) {
  const CameraTrajectory trajectory = square();
  EXPECT_TRUE(trajectory.cameraPose(3.0, 0.0, 0.0).isApprox(trajectory.cameraPose(9.0, 0.0, 0.0)));
  double largest = 0.0;
  for (double t = 0.0; t < 20.0; t += 0.01) {
    const Eigen::Isometry3d still = trajectory.cameraPose(t, 0.0, 0.0);
    const Eigen::Isometry3d once = trajectory.cameraPose(t, 0.0, 1.0);
    const Eigen::Isometry3d next = trajectory.cameraPose(t + 0.01, 0.0, 1.0);
    largest = std::max(largest, (once.translation() - still.translation()).norm());
    ASSERT_LT((next.translation() - once.translation()).norm(), 0.01);
    ASSERT_TRUE(once.linear().isUnitary(1e-9));
    const Eigen::Isometry3d twice = trajectory.cameraPose(t, 0.0, 2.0);
    ASSERT_TRUE((twice.translation() - still.translation())
                    .isApprox(2.0 * (once.translation() - still.translation()), 1e-6));
  }
  EXPECT_GT(largest, 0.02);
  EXPECT_LT(largest, 0.06);
}

/// Whether a point is inside a wall or thing: near to a surface that it has just passed.
TEST(Scenes, TrajectoriesAreClosedAndSmoothInAllOfThem) {
  for (std::uint32_t seed = 1; seed < 6; ++seed) {
    for (const Scene& scene : {makeStreet(seed, {}), makeStreet(seed, {0, 0.0, 1.0}),
                               makeIndoor(seed), makeCorridor(seed), makePlaster(seed)}) {
      const CameraTrajectory& trajectory = scene.trajectory;
      ASSERT_GT(trajectory.length_m(), 20.0);
      ASSERT_TRUE(trajectory.at(0.0).isApprox(trajectory.at(trajectory.length_m()), 1e-6));
      for (double t = 0.0; t < 100.0; t += 0.05) {
        const Eigen::Isometry3d motion = trajectory.cameraPose(t, 1.0, 1.0).inverse() *
                                         trajectory.cameraPose(t + 0.05, 1.0, 1.0);
        ASSERT_LT(motion.translation().norm(), 0.05 * 13.0);
        ASSERT_LT(Eigen::AngleAxisd(motion.linear()).angle(), 0.05 * 2.0);
      }
    }
  }
}

/// Intersections of the line between two points with the visible sides of a scene's surfaces.
bool passesASurface(const Scene& scene, const Vector3d& from, const Vector3d& to) {
  for (const Instance& instance : scene.instances) {
    const Object& object = scene.objects[instance.object];
    const Vector3d centre = instance.T_world_object * object.centre;
    if ((centre - from).norm() > object.radius_m + (to - from).norm()) continue;
    const Vector3d a = instance.T_world_object.inverse() * from;
    const Vector3d b = instance.T_world_object.inverse() * to;
    for (const Surface& surface : object.surfaces) {
      const Vector3d normal = surface.axis_u.cross(surface.axis_v);
      const double height_a = normal.dot(a - surface.origin);
      const double height_b = normal.dot(b - surface.origin);
      if (height_a <= 0.0 || height_b > 0.0) continue;
      const Vector3d hit = a + (b - a) * (height_a / (height_a - height_b)) - surface.origin;
      const Eigen::Vector2d position(hit.dot(surface.axis_u), hit.dot(surface.axis_v));
      bool inside = true;
      for (std::size_t i = 0; i < surface.num_corners; ++i) {
        const Eigen::Vector2d p = surface.corners[i].cast<double>();
        const Eigen::Vector2d q = surface.corners[(i + 1) % surface.num_corners].cast<double>();
        const Eigen::Vector2d along = q - p;
        const Eigen::Vector2d offset = position - p;
        inside = inside && along.x() * offset.y() - along.y() * offset.x() >= 0.0;
      }
      if (inside) return true;
    }
  }
  return false;
}

TEST(Scenes, TheCameraCollidesWithNothing) {
  for (std::uint32_t seed = 1; seed < 6; ++seed) {
    for (const Scene& scene : {makeStreet(seed, {}), makeStreet(seed, {0, 0.0, 1.0}),
                               makeIndoor(seed), makeCorridor(seed), makePlaster(seed)}) {
      constexpr double kStep = 0.1;
      for (double t = 0.0; t < 150.0; t += kStep) {
        const Vector3d from = scene.trajectory.cameraPose(t, 1.0, 1.0).translation();
        const Vector3d to = scene.trajectory.cameraPose(t + kStep, 1.0, 1.0).translation();
        ASSERT_FALSE(passesASurface(scene, from, to)) << "seed " << seed << " at " << t << " s";
      }
    }
  }
}

TEST(Scenes, PlasterIsFlownThroughFastWithFastTurns) {
  for (std::uint32_t seed = 1; seed < 6; ++seed) {
    const CameraTrajectory trajectory = makePlaster(seed).trajectory;
    EXPECT_GT(trajectory.length_m(), 90.0);  // no room twice in 100 m
    double fastest_m_s = 0.0;
    double fastest_deg_s = 0.0;
    double turned_deg = 0.0;
    constexpr double kStep_s = 0.05;
    constexpr double kDuration_s = 60.0;
    for (double t = 0.0; t < kDuration_s; t += kStep_s) {
      const Eigen::Isometry3d motion = trajectory.cameraPose(t, 1.0, 1.0).inverse() *
                                       trajectory.cameraPose(t + kStep_s, 1.0, 1.0);
      const double angle_deg = Eigen::AngleAxisd(motion.linear()).angle() * 180.0 / M_PI;
      fastest_m_s = std::max(fastest_m_s, motion.translation().norm() / kStep_s);
      fastest_deg_s = std::max(fastest_deg_s, angle_deg / kStep_s);
      turned_deg += angle_deg;
    }
    EXPECT_NEAR(trajectory.travelled_m(kDuration_s, 1.0) / kDuration_s, 1.8, 0.15);
    EXPECT_NEAR(fastest_m_s, 2.05, 0.1);
    EXPECT_NEAR(fastest_deg_s, 100.0, 12.0);
    EXPECT_GT(turned_deg / kDuration_s, 20.0);
  }
}

TEST(Scenes, MovingCarsFollowTheRoad) {
  const Scene scene = makeStreet(4, {6});
  ASSERT_EQ(scene.movers.size(), 6U);
  const std::vector<Instance> before = poseMovers(scene, 10.0, 0.0);
  const std::vector<Instance> after = poseMovers(scene, 10.1, 0.0);
  for (std::size_t i = 0; i < before.size(); ++i) {
    const Vector3d motion =
        after[i].T_world_object.translation() - before[i].T_world_object.translation();
    const double speed = std::abs(scene.movers[i].speed_m_s);
    EXPECT_GT(motion.norm() / 0.1, 0.4 * speed);  // beside the trajectory: other radii
    EXPECT_LT(motion.norm() / 0.1, 2.0 * speed);
    EXPECT_EQ(after[i].T_world_object.translation().z(), 0.0);
    // It drives forwards.
    EXPECT_GT(motion.normalized().dot(before[i].T_world_object.linear().col(0)), 0.99);
  }
}

TEST(Scenes, TheCameraDrivesThroughNoCar) {
  constexpr double kLength_m = 4.5;
  constexpr double kWidth_m = 1.9;
  for (const std::uint32_t seed : {1U, 2U, 3U}) {
    const Scene scene = makeStreet(seed, {12});
    for (double t = 0.0; t < 30.0; t += 0.1) {
      const Vector3d camera = scene.trajectory.cameraPose(t, 1.0, 1.0).translation();
      for (const Instance& car : poseMovers(scene, t, scene.trajectory.travelled_m(t, 1.0))) {
        const Vector3d p = car.T_world_object.inverse() * camera;
        EXPECT_FALSE(std::abs(p.x()) < 0.5 * kLength_m && std::abs(p.y()) < 0.5 * kWidth_m)
            << "seed " << seed << " at " << t << " s";
      }
    }
  }
}

}  // namespace
}  // namespace point_line_odometry::world
