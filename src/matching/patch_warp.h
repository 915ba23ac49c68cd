#pragma once

#include <Eigen/Geometry>
#include <optional>

#include "matching/patch_aligner.h"
#include "matching/stereo_frame.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// The pixel axes of a plane through p_camera = Z K^-1 (u, v, 1). \param slope of the plane, as
/// StereoPoint's: minus the derivative of the disparity d = fx b / Z by the left pixel; so dZ = Z /
/// d slope^T d(u, v). Zero for a plane parallel to the images.
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

/// Those of a stereo point; a far one has no slope.
inline PixelAxes pixelAxes(const StereoCamera& camera, const StereoPoint& point) {
  return pixelAxes(camera, point.triangulated.p_camera,
                   point.far ? Eigen::Vector2f::Zero() : point.slope);
}

/// Affine warp of a patch: Jacobian of the pixel in the image that the patch was taken from by the
/// pixel in this camera's image. \param p_camera centre of the patch, in front of this camera.
/// \param axes pixel axes of the patch's image, in this camera's frame. Nothing if the patch
/// appears so much smaller or larger that the two cannot be aligned.
inline std::optional<Eigen::Matrix2f> patchWarp(const StereoCamera& camera,
                                                const Eigen::Vector3d& p_camera,
                                                const PixelAxes& axes) {
  constexpr double kMinAreaRatio = 0.4;
  constexpr double kMaxAreaRatio = 6.0;
  const double inverse_z = 1.0 / p_camera.z();
  Eigen::Matrix<double, 2, 3> projection;
  projection << camera.fx, 0.0, -camera.fx * p_camera.x() * inverse_z,  //
      0.0, camera.fy, -camera.fy * p_camera.y() * inverse_z;
  const Eigen::Matrix2d warp_image_patch = inverse_z * projection * axes;
  const double area_ratio = warp_image_patch.determinant();
  if (!(area_ratio >= kMinAreaRatio && area_ratio <= kMaxAreaRatio)) return std::nullopt;
  return Eigen::Matrix2f(warp_image_patch.inverse().cast<float>());
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

/// A patch of one image, warped to both images of a stereo pair.
struct StereoPatch {
  PatchAligner left;
  PatchAligner right;

  explicit StereoPatch(const PatchAligner& in_both) : left(in_both), right(in_both) {}
  StereoPatch(const cv::Mat& image, const Eigen::Vector2f& pixel, const StereoWarp& warp)
      : left(image, pixel, warp.left), right(image, pixel, warp.right) {}
};

}  // namespace point_line_odometry
