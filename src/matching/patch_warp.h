#pragma once

#include <Eigen/Geometry>
#include <optional>

#include "point_line_odometry/matching.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// On the surface at a point whose columns in the right image change by `slope` more than those in
/// the left one, per pixel right and down: its disparity falls by as much. Zero: it faces the
/// cameras.
inline PixelAxes pixelAxes(const StereoCamera& camera, const Eigen::Vector3d& p_camera,
                           const Eigen::Vector2f& slope) {
  const double depth_m = p_camera.z();
  PixelAxes axes = PixelAxes::Zero();
  axes(0, 0) = depth_m / camera.fx;
  axes(1, 1) = depth_m / camera.fy;
  const double disparity_px = camera.fx * camera.baseline_m / depth_m;
  axes += p_camera * slope.cast<double>().transpose() / disparity_px;
  return axes;
}

/// How the image of a small surface changes: pixels of the image in which it was first seen, per
/// pixel of this camera's image. \param p_camera its place, in front of this camera.
/// \param axes where one pixel of the first image leads on it, in this camera's frame. Nothing if
/// it looks so much smaller or larger that the two cannot be compared.
inline std::optional<Eigen::Matrix2f> patchWarp(const StereoCamera& camera,
                                                const Eigen::Vector3d& p_camera,
                                                const PixelAxes& axes) {
  constexpr double kMinGrowth = 0.4;  // of the area
  constexpr double kMaxGrowth = 6.0;
  const double inverse_z = 1.0 / p_camera.z();
  Eigen::Matrix<double, 2, 3> projection;
  projection << camera.fx, 0.0, -camera.fx * p_camera.x() * inverse_z,  //
      0.0, camera.fy, -camera.fy * p_camera.y() * inverse_z;
  const Eigen::Matrix2d image_by_patch = inverse_z * projection * axes;
  const double growth = image_by_patch.determinant();
  if (!(growth >= kMinGrowth && growth <= kMaxGrowth)) return std::nullopt;
  return Eigen::Matrix2f(image_by_patch.inverse().cast<float>());
}

/// The same for both images of a stereo pair.
struct StereoWarp {
  Eigen::Matrix2f left;
  Eigen::Matrix2f right;
};

inline std::optional<StereoWarp> stereoPatchWarp(const StereoCamera& camera,
                                                 const Eigen::Vector3d& p_left,
                                                 const PixelAxes& axes) {
  if (!(p_left.z() > camera.baseline_m)) return std::nullopt;
  const auto left = patchWarp(camera, p_left, axes);
  const auto right = patchWarp(camera, p_left - camera.baseline_m * Eigen::Vector3d::UnitX(), axes);
  if (!left || !right) return std::nullopt;
  return StereoWarp{*left, *right};
}

/// A patch of one image as both images of a stereo pair should see it.
struct StereoPatch {
  PatchAligner left;
  PatchAligner right;

  explicit StereoPatch(const PatchAligner& in_both) : left(in_both), right(in_both) {}
  StereoPatch(const cv::Mat& image, const Eigen::Vector2f& pixel, const StereoWarp& warp)
      : left(image, pixel, warp.left), right(image, pixel, warp.right) {}
};

}  // namespace point_line_odometry
