/// The street's hill: its shape, what is seen on it, and the dashes of its road.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "ray_caster.h"
#include "world/renderer.h"
#include "world/scene.h"
#include "world/street.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Vector3d;

constexpr double kRoadHalf_m = 6.0;
constexpr double kFrame_s = 0.1;

Scene hilly(std::uint32_t seed) { return makeStreet(seed, {0, 0.0, 1.0}); }

CameraCalibration pinhole(double focal, int width, int height) {
  CameraCalibration camera;
  camera.width = width;
  camera.height = height;
  camera.K << focal, 0.0, 0.5 * (width - 1), 0.0, focal, 0.5 * (height - 1), 0.0, 0.0, 1.0;
  camera.P.leftCols<3>() = camera.K;
  return camera;
}

/// KITTI's field of view with one pixel for 12 x 12.
PixelRays coarseKittiRays() {
  return PixelRays::ofRectifiedImage(pinhole(718.856 / 12.0, 103, 31));
}

TEST(Hill, IsSmoothAndHasTheGivenHeight) {
  const Hill hill{7.0, 100.0, 75.0};
  EXPECT_NEAR(hill.heightAt(100.0), 7.0, 1e-12);
  EXPECT_NEAR(hill.heightAt(62.5), 3.5, 1e-12);
  EXPECT_NEAR(hill.heightAt(25.0), 0.0, 1e-12);
  EXPECT_NEAR(hill.heightAt(-900.0), 0.0, 1e-12);
  EXPECT_EQ(Hill().heightAt(3.0), 0.0);
  double steepest = 0.0;
  for (double x = 0.0; x < 200.0; x += 0.1) {
    steepest = std::max(steepest, (hill.heightAt(x + 0.1) - hill.heightAt(x)) / 0.1);
  }
  EXPECT_NEAR(steepest, 0.147, 0.001);  // a road may be as steep
}

TEST(Hill, TheCarDrivesOnItsGroundAndPitchesWithIt) {
  for (std::uint32_t seed = 1; seed < 6; ++seed) {
    const Scene scene = hilly(seed);
    double highest = 0.0;
    for (double t = 0.0; t < 25.0; t += kFrame_s) {
      const Eigen::Isometry3d pose = scene.trajectory.cameraPose(t, 1.0, 0.0);
      const Vector3d position = pose.translation();
      const double ground = scene.hill.heightAt(position.x());
      ASSERT_NEAR(position.z() - ground, 1.65, 0.05) << t;
      const double slope =
          (scene.hill.heightAt(position.x() + 0.1) - scene.hill.heightAt(position.x() - 0.1)) / 0.2;
      const Vector3d ahead = pose.linear().col(2);
      if (std::abs(ahead.y()) < 0.01) {
        ASSERT_NEAR(ahead.z() / ahead.x(), slope, 0.01) << t;
      }
      highest = std::max(highest, ground);
    }
    EXPECT_NEAR(highest, 7.0, 0.05);
  }
}

/// Shares of an image.
struct Shares {
  double sky = 0.0;
  double road = 0.0;
  double verge = 0.0;
};

Shares sharesAt(const Scene& scene, double time_s, const PixelRays& rays) {
  const RayCaster caster(scene, scene.trajectory.cameraPose(time_s, 1.0, 1.0),
                         rays.bounds(rays.all()));
  Shares shares;
  const double pixel = 1.0 / (rays.width() * rays.height());
  for (int y = 0; y < rays.height(); ++y) {
    for (int x = 0; x < rays.width(); ++x) {
      const auto hit = caster.hit(rays.corner(x, y));
      if (!hit) {
        shares.sky += pixel;
      } else if (std::abs(hit->z() - scene.hill.heightAt(hit->x())) < 0.05) {
        (std::abs(hit->y()) < kRoadHalf_m ? shares.road : shares.verge) += pixel;
      }
    }
  }
  return shares;
}

TEST(Hill, LittleIsSeenForSecondsButRoadVergeAndSky) {
  const PixelRays rays = coarseKittiRays();
  for (const std::uint32_t seed : {1U, 2U, 3U}) {
    const Scene scene = hilly(seed);
    int bare = 0;  // frames in which all but 2 % is road, verge and sky
    double least_verge = 1.0;
    for (double t = 2.0; t < 10.0; t += kFrame_s) {
      const Shares shares = sharesAt(scene, t, rays);
      if (shares.sky + shares.road + shares.verge < 0.98) continue;
      ++bare;
      if (shares.sky > 0.5 && shares.road > 0.15) {
        least_verge = std::min(least_verge, shares.verge);
      }
    }
    RecordProperty("frames_of_seed_" + std::to_string(seed), bare);
    EXPECT_GE(bare, 30) << seed;
    EXPECT_LT(least_verge, 0.15) << seed;
  }
}

/// Values of x at which dashes in the middle of a road begin and end, seen from above.
std::vector<double> edgesOfPaint(const Scene& scene, double middle_x) {
  constexpr double kHeight = 20.0;
  constexpr double kFocal = 800.0;
  constexpr int kWidth = 1001;
  const PixelRays rays = PixelRays::ofRectifiedImage(pinhole(kFocal, kWidth, 3));
  Eigen::Isometry3d T_world_camera = Eigen::Isometry3d::Identity();
  T_world_camera.linear() = Vector3d(1.0, -1.0, -1.0).asDiagonal();
  T_world_camera.translation() = Vector3d(middle_x, 0.0, kHeight);
  const cv::Mat image = render(scene, {}, {{&rays, T_world_camera}})[0];
  std::vector<double> edges;
  for (int x = 1; x < kWidth; ++x) {
    const bool before = image.at<float>(1, x - 1) > 0.5F;
    if (before == (image.at<float>(1, x) > 0.5F)) continue;
    edges.push_back(middle_x + (x - 0.5 - 0.5 * (kWidth - 1)) * kHeight / kFocal);
  }
  return edges;
}

TEST(Hill, DashesRepeat) {
  const Scene scene = hilly(2);
  const double behind = scene.hill.middle_x + scene.hill.half_length_m + 20.0;
  const std::vector<double> edges = edgesOfPaint(scene, behind);
  ASSERT_GE(edges.size(), 5U);
  for (std::size_t i = 2; i < edges.size(); ++i) {
    EXPECT_NEAR(edges[i] - edges[i - 2], LaneDashes::kPeriod_m, 0.06);
    const double length = edges[i] - edges[i - 1];
    EXPECT_NEAR(std::min(length, LaneDashes::kPeriod_m - length), LaneDashes::kLength_m, 0.06);
  }
}

TEST(Hill, CarsDriveOverIt) {
  const Scene scene = makeStreet(3, {4, 0.0, 1.0});
  double highest = 0.0;
  for (double t = 0.0; t < 60.0; t += 0.5) {
    for (const Instance& mover : poseMovers(scene, t, 0.0)) {
      const Vector3d position = mover.T_world_object.translation();
      ASSERT_EQ(position.z(), scene.hill.heightAt(position.x()));
      highest = std::max(highest, position.z());
    }
  }
  EXPECT_GT(highest, 6.0);
}

}  // namespace
}  // namespace point_line_odometry::world
