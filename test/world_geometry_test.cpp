/// Images and ground truth agree: one image is warped into the other by the exact geometry.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "ray_caster.h"
#include "world/plaster.h"
#include "world/renderer.h"
#include "world/scene.h"
#include "world/street.h"

namespace point_line_odometry::world {
namespace {

constexpr double kFocal = 460.0;
constexpr int kWidth = 376;
constexpr int kHeight = 240;

PixelRays rays() {
  CameraCalibration camera;
  camera.width = kWidth;
  camera.height = kHeight;
  camera.K << kFocal, 0.0, 187.5, 0.0, kFocal, 119.5, 0.0, 0.0, 1.0;
  camera.P.leftCols<3>() = camera.K;
  return PixelRays::ofRectifiedImage(camera);
}

/// Mean absolute differences between an image and another one, at points that both see.
struct Differences {
  double warped = 0.0;  ///< where the geometry says
  double still = 0.0;   ///< at the same pixel
  int count = 0;
};

/// Brightness between the pixels; nothing outside of the image.
std::optional<double> sample(const cv::Mat& image, double x, double y) {
  const int ix = static_cast<int>(std::floor(x));
  const int iy = static_cast<int>(std::floor(y));
  if (ix < 0 || iy < 0 || ix + 1 >= image.cols || iy + 1 >= image.rows) return std::nullopt;
  const double fx = x - ix;
  const double fy = y - iy;
  const auto at = [&](int dx, int dy) {
    return static_cast<double>(image.at<float>(iy + dy, ix + dx));
  };
  return (1.0 - fy) * ((1.0 - fx) * at(0, 0) + fx * at(1, 0)) +
         fy * ((1.0 - fx) * at(0, 1) + fx * at(1, 1));
}

Differences compare(const Scene& scene, const Eigen::Isometry3d& T_world_a,
                    const Eigen::Isometry3d& T_world_b) {
  const PixelRays camera = rays();
  const std::vector<cv::Mat> images =
      render(scene, {}, {{&camera, T_world_a}, {&camera, T_world_b}});
  const RayCaster from_a(scene, T_world_a, camera.bounds(camera.all()));
  const RayCaster from_b(scene, T_world_b, camera.bounds(camera.all()));
  Differences sum;
  for (int y = 2; y < kHeight - 2; y += 3) {
    for (int x = 2; x < kWidth - 2; x += 3) {
      const cv::Point2f ray = 0.5F * (camera.corner(x, y) + camera.corner(x + 1, y + 1));
      const auto point = from_a.hit(ray);
      if (!point) continue;
      const Eigen::Vector3d in_b = T_world_b.inverse() * *point;
      const cv::Point2f back(static_cast<float>(in_b.x() / in_b.z()),
                             static_cast<float>(in_b.y() / in_b.z()));
      const auto warped = sample(images[1], kFocal * back.x + 187.5, kFocal * back.y + 119.5);
      if (!warped || in_b.z() < 0.1) continue;
      const auto seen = from_b.hit(back);
      if (!seen || (*seen - *point).norm() > 0.02 * in_b.z()) continue;  // hidden
      const double value = static_cast<double>(images[0].at<float>(y, x));
      sum.warped += std::abs(*warped - value);
      sum.still += std::abs(static_cast<double>(images[1].at<float>(y, x)) - value);
      ++sum.count;
    }
  }
  return {sum.warped / sum.count, sum.still / sum.count, sum.count};
}

struct Situation {
  std::string name;
  std::function<Scene()> make;
  double time_s;  ///< of the first image
  double step_s;
};

class HardScenes : public testing::TestWithParam<Situation> {};

TEST_P(HardScenes, PosesAreExact) {
  const Situation situation = GetParam();
  const Scene scene = situation.make();
  const Eigen::Isometry3d T_world_a = scene.trajectory.cameraPose(situation.time_s, 1.0, 1.0);
  const Eigen::Isometry3d T_world_b =
      scene.trajectory.cameraPose(situation.time_s + situation.step_s, 1.0, 1.0);
  Eigen::Isometry3d T_left_right = Eigen::Isometry3d::Identity();
  T_left_right.translation().x() = 0.11;
  for (const Eigen::Isometry3d& other : {T_world_b, Eigen::Isometry3d(T_world_a * T_left_right)}) {
    const Differences exact = compare(scene, T_world_a, other);
    EXPECT_GT(exact.count, 2000);
    EXPECT_LT(exact.warped, 0.25 * exact.still);
  }
}

INSTANTIATE_TEST_SUITE_P(
    World, HardScenes,
    testing::Values(Situation{"plaster", [] { return makePlaster(1); }, 4.0, 0.05},
                    Situation{"plasterInATurn", [] { return makePlaster(2); }, 8.3, 0.05},
                    Situation{"hill",
                              [] {
                                return makeStreet(1, {0, 0.0, 1.0});
                              },
                              5.0, 0.1}),
    [](const testing::TestParamInfo<Situation>& situation) { return situation.param.name; });

}  // namespace
}  // namespace point_line_odometry::world
