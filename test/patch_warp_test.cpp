/// Patches of planes that the camera moves along: roads and walls.

#include "matching/patch_warp.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>
#include <random>
#include <vector>

#include "common/statistics.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector2f;
using Eigen::Vector3d;
using synthetic::transform;

/// Of a small image, with the horizon in its upper half.
StereoCamera makeCamera() {
  StereoCamera camera = synthetic::camera();
  camera.cx = 200.0;
  camera.cy = 60.0;
  camera.width = 400;
  camera.height = 240;
  return camera;
}

const StereoCamera kCamera = makeCamera();

/// A plane normal . p = distance_m in the first camera's frame, of waves in all directions.
class WavyPlane {
 public:
  WavyPlane(const Vector3d& normal, double distance_m, unsigned seed = 3)
      : normal_(normal.normalized()), distance_m_(distance_m) {
    const Vector3d other = std::abs(normal_.z()) < 0.9 ? Vector3d::UnitZ() : Vector3d::UnitX();
    along_ = (other - other.dot(normal_) * normal_).normalized();
    across_ = normal_.cross(along_);
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> angle(0.0, 2.0 * M_PI);
    std::uniform_real_distribution<double> log_length(std::log(0.3), std::log(1.2));
    for (Wave& wave : waves_) {
      const double k = 2.0 * M_PI / std::exp(log_length(random));
      const double direction = angle(random);
      wave = {k * Vector2d(std::cos(direction), std::sin(direction)), angle(random)};
    }
  }

  /// Where the ray of a pixel meets the plane, in the first camera's frame.
  Vector3d at(const Vector2d& pixel, const Isometry3d& T_first_camera) const {
    const Vector3d ray =
        T_first_camera.linear() *
        Vector3d((pixel.x() - kCamera.cx) / kCamera.fx, (pixel.y() - kCamera.cy) / kCamera.fy, 1.0);
    const Vector3d& centre = T_first_camera.translation();
    return centre + (distance_m_ - normal_.dot(centre)) / normal_.dot(ray) * ray;
  }

  /// Derivative of the right column minus the left one by the left pixel: of -fx b / Z.
  Vector2f slope() const {
    const Vector2d gradient(normal_.x(), normal_.y() * kCamera.fx / kCamera.fy);
    return (-kCamera.baseline_m / distance_m_ * gradient).cast<float>();
  }

  cv::Mat image(const Isometry3d& T_first_camera) const {
    constexpr int kSamples = 2;
    constexpr int kFirstRow = 100;  // above it waves are shorter than a pixel
    cv::Mat image(kCamera.height, kCamera.width, CV_8UC1, cv::Scalar(128));
    for (int v = kFirstRow; v < image.rows; ++v) {
      for (int u = 0; u < image.cols; ++u) {
        double sum = 0.0;
        for (int i = 0; i < kSamples * kSamples; ++i) {
          const Vector2d within((i % kSamples + 0.5) / kSamples - 0.5,
                                (i / kSamples + 0.5) / kSamples - 0.5);
          sum += brightness(at(Vector2d(u, v) + within, T_first_camera));
        }
        image.at<uchar>(v, u) = cv::saturate_cast<uchar>(sum / (kSamples * kSamples));
      }
    }
    return image;
  }

 private:
  struct Wave {
    Vector2d k;
    double phase;
  };

  double brightness(const Vector3d& p) const {
    const Vector2d on_plane(along_.dot(p), across_.dot(p));
    double sum = 128.0;
    for (const Wave& wave : waves_) sum += 10.0 * std::sin(wave.k.dot(on_plane) + wave.phase);
    return sum;
  }

  Vector3d normal_;
  double distance_m_;
  Vector3d along_;
  Vector3d across_;
  std::array<Wave, 24> waves_;
};

/// A road, and a wall beside it.
const std::vector<WavyPlane> kPlanes = {{Vector3d(0.0, 1.0, 0.0), 1.65},
                                        {Vector3d(1.0, 0.0, -0.1), 1.5}};

/// The patch of a plane around a pixel of the first camera, seen by another one.
std::optional<StereoWarp> warpOf(const WavyPlane& plane, const Vector2d& pixel,
                                 const Isometry3d& T_camera_first) {
  StereoPoint point;
  point.triangulated.p_camera = plane.at(pixel, Isometry3d::Identity());
  point.slope = plane.slope();
  return stereoPatchWarp(kCamera, T_camera_first * point.triangulated.p_camera,
                         rotated(T_camera_first.linear(), patchPlane(kCamera, point)));
}

Vector2d apply(const PatchWarp& warp, const Vector2d& offset) {
  const Vector2f x = offset.cast<float>();
  return (warp.linear * x / (1.0F + warp.projective.dot(x))).cast<double>();
}

/// The same pixels by the geometry: where rays of the other images meet the plane.
TEST(PatchWarp, IsTheHomographyOfThePlane) {
  const Isometry3d T_camera_first = transform({0.02, -0.03, 0.05}, {0.2, -0.1, -2.0});
  const Isometry3d T_camera_right = transform(Vector3d::Zero(), {kCamera.baseline_m, 0.0, 0.0});
  for (const WavyPlane& plane : kPlanes) {
    const Vector2d pixel(330.0, 160.0);
    const auto warp = warpOf(plane, pixel, T_camera_first);
    ASSERT_TRUE(warp);
    const Vector3d p = T_camera_first * plane.at(pixel, Isometry3d::Identity());
    for (const Vector2d& offset : {Vector2d(7.0, 7.0), Vector2d(-7.0, 7.0), Vector2d(7.0, -5.0)}) {
      const Isometry3d T_first_left = T_camera_first.inverse();
      const Isometry3d T_first_right = T_first_left * T_camera_right;
      const Vector3d left = plane.at(kCamera.projectLeft(p) + offset, T_first_left);
      const Vector3d right = plane.at(kCamera.projectRight(p) + offset, T_first_right);
      EXPECT_LT((apply(warp->left, offset) - (kCamera.projectLeft(left) - pixel)).norm(), 1e-3);
      EXPECT_LT((apply(warp->right, offset) - (kCamera.projectLeft(right) - pixel)).norm(), 1e-3);
      const Vector2d affine = warp->left.linear.cast<double>() * offset;
      EXPECT_GT((affine - (kCamera.projectLeft(left) - pixel)).norm(), 0.03) << "tests nothing";
    }
  }
}

TEST(PatchWarp, OfAnOctaveIsTheSameInItsPixels) {
  const auto warp =
      warpOf(kPlanes[0], {280.0, 160.0}, transform(Vector3d::Zero(), {0.0, 0.0, -2.0}));
  ASSERT_TRUE(warp);
  const StereoWarp coarse = inOctave(*warp, 2.0F);
  const Vector2d offset(3.0, -4.0);
  EXPECT_LT((2.0 * apply(coarse.left, offset) - apply(warp->left, 2.0 * offset)).norm(), 1e-5);
  EXPECT_LT((2.0 * apply(coarse.right, offset) - apply(warp->right, 2.0 * offset)).norm(), 1e-5);
}

/// Median error of the aligned patches away from where the camera goes [px].
double medianOutwardError(const WavyPlane& plane, bool affine) {
  const Isometry3d T_first_camera = transform(Vector3d::Zero(), {0.0, 0.0, 4.0});
  const cv::Mat first = plane.image(Isometry3d::Identity());
  const cv::Mat second = plane.image(T_first_camera);
  const Vector2d centre(kCamera.cx, kCamera.cy);
  std::vector<double> errors;
  for (int v = 145; v < 170; v += 2) {
    for (int u = 150; u < 260; u += 3) {
      const Vector2d pixel(u, v);
      const Vector3d p = T_first_camera.inverse() * plane.at(pixel, Isometry3d::Identity());
      const Vector2d expected = kCamera.projectLeft(p);
      auto warp = warpOf(plane, pixel, T_first_camera.inverse());
      if (!warp) continue;
      if (affine) warp->left.projective.setZero();
      const auto aligned = PatchAligner(first, pixel.cast<float>(), warp->left)
                               .align(second, expected.cast<float>());
      if (!aligned) continue;
      errors.push_back(
          (aligned->pixel.cast<double>() - expected).dot((expected - centre).normalized()));
    }
  }
  EXPECT_GT(errors.size(), 100U);
  return median(errors);
}

/// What is nearer moves faster: without the perspective within a patch a road is found too far
/// outward, and the motion is too long.
TEST(PatchWarp, DoesNotBiasTheMotionAlongARoad) {
  constexpr int kRoads = 6;
  double error = 0.0;
  double of_affine = 0.0;
  for (unsigned seed = 0; seed < kRoads; ++seed) {
    const WavyPlane road(Vector3d(0.0, 1.0, 0.0), 1.65, seed);
    error += medianOutwardError(road, false) / kRoads;
    of_affine += medianOutwardError(road, true) / kRoads;
  }
  EXPECT_LT(std::abs(error), 0.01);
  EXPECT_GT(of_affine, 0.015 + error);
}

}  // namespace
}  // namespace point_line_odometry
