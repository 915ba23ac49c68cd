#pragma once

#include <Eigen/Geometry>
#include <optional>

#include "matching/patch_aligner.h"
#include "matching/stereo_frame.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// The plane of a patch, as its source image shows it.
struct PatchPlane {
  /// Jacobian of its point by the pixel (u, v) there, in the frame of a camera or of the
  /// map [m / px].
  Eigen::Matrix<double, 3, 2> axes = Eigen::Matrix<double, 3, 2>::Zero();
  /// Of the logarithm of its depth, by the pixel there [1 / px].
  Eigen::Vector2d log_depth_gradient = Eigen::Vector2d::Zero();
};

/// The plane in another frame.
inline PatchPlane rotated(const Eigen::Matrix3d& R, const PatchPlane& plane) {
  return {R * plane.axes, plane.log_depth_gradient};
}

/// The plane of a patch. \param p_camera its centre Z K^-1 (u, v, 1). \param slope of the plane, as
/// StereoPoint's: minus the derivative of the disparity d = fx b / Z by the left pixel; so dZ = Z /
/// d slope^T d(u, v). Zero for a plane parallel to the images.
inline PatchPlane patchPlane(const StereoCamera& camera, const Eigen::Vector3d& p_camera,
                             const Eigen::Vector2f& slope) {
  const double depth_m = p_camera.z();
  const double disparity_px = camera.fx * camera.baseline_m / depth_m;
  PatchPlane plane;
  plane.log_depth_gradient = slope.cast<double>() / disparity_px;
  plane.axes(0, 0) = depth_m / camera.fx;
  plane.axes(1, 1) = depth_m / camera.fy;
  plane.axes += p_camera * plane.log_depth_gradient.transpose();
  return plane;
}

/// That of a stereo point; a far one has no slope.
inline PatchPlane patchPlane(const StereoCamera& camera, const StereoPoint& point) {
  return patchPlane(camera, point.triangulated.p_camera,
                    point.far ? Eigen::Vector2f::Zero() : point.slope);
}

/// Warp from this camera's image to the source image of a patch. \param p_camera centre of the
/// patch, in front of this camera. \param plane in this camera's frame. Nothing if the patch
/// appears so much smaller or larger that the two cannot be aligned.
///
/// On a plane the inverse depth is linear in the pixels of any image. So, with e the offset in the
/// source image and l the gradient of the log depth there, p(e) (1 - l^T e) is linear in e, also in
/// this camera's frame: its projection is B e / (1 + h^T e), with B the Jacobian and h = axes_z / Z
/// - l. The inverse is e = A x / (1 - h^T A x), with A = B^-1.
inline std::optional<PatchWarp> patchWarp(const StereoCamera& camera,
                                          const Eigen::Vector3d& p_camera,
                                          const PatchPlane& plane) {
  constexpr double kMinAreaRatio = 0.4;
  constexpr double kMaxAreaRatio = 6.0;
  const double inverse_z = 1.0 / p_camera.z();
  Eigen::Matrix<double, 2, 3> projection;
  projection << camera.fx, 0.0, -camera.fx * p_camera.x() * inverse_z,  //
      0.0, camera.fy, -camera.fy * p_camera.y() * inverse_z;
  const Eigen::Matrix2d J_image_patch = inverse_z * projection * plane.axes;
  const double area_ratio = J_image_patch.determinant();
  if (!(area_ratio >= kMinAreaRatio && area_ratio <= kMaxAreaRatio)) return std::nullopt;
  const Eigen::Matrix2d J_patch_image = J_image_patch.inverse();
  const Eigen::Vector2d h = inverse_z * plane.axes.row(2).transpose() - plane.log_depth_gradient;
  PatchWarp warp;
  warp.linear = J_patch_image.cast<float>();
  warp.projective = (-J_patch_image.transpose() * h).cast<float>();
  return warp;
}

/// The same for both images of a stereo pair.
struct StereoWarp {
  PatchWarp left;
  PatchWarp right;
};

inline std::optional<StereoWarp> stereoPatchWarp(const StereoCamera& camera,
                                                 const Eigen::Vector3d& p_left,
                                                 const PatchPlane& plane) {
  if (!(p_left.z() > camera.baseline_m)) return std::nullopt;
  const auto left = patchWarp(camera, p_left, plane);
  const auto right =
      patchWarp(camera, p_left - camera.baseline_m * Eigen::Vector3d::UnitX(), plane);
  if (!left || !right) return std::nullopt;
  return StereoWarp{*left, *right};
}

/// The warp in an octave of the images, whose pixels are `ratio` of theirs.
inline StereoWarp inOctave(StereoWarp warp, float ratio) {
  warp.left.projective *= ratio;
  warp.right.projective *= ratio;
  return warp;
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
