#include "geometry/rolling_shutter.h"

#include <algorithm>

#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

/// Nearer to the camera than this share of its depth no point comes while an image is read out.
constexpr double kLeastDepthRatio = 0.1;

}  // namespace

double RollingShutter::timeOf(const StereoCamera& camera, double row) const {
  const double share = (row + 0.5) / camera.height - 0.5;
  return read_out_s_ * camera.raw_rows * std::clamp(share, -0.5, 0.5);
}

PixelWithDisparity RollingShutter::atStamp(const StereoCamera& camera,
                                           const PixelWithDisparity& exposed) const {
  if (isGlobal()) return exposed;
  const double t = timeOf(camera, exposed.left_px.y());
  const Eigen::Vector3d ray((exposed.left_px.x() - camera.cx) / camera.fx,
                            (exposed.left_px.y() - camera.cy) / camera.fy, 1.0);
  const double inverse_depth = exposed.disparity_px / (camera.fx * camera.baseline_m);
  // The point over its depth: exists for points at infinity, too.
  const Eigen::Vector3d at_stamp =
      expSO3(t * velocity_.tail<3>()) * ray + t * inverse_depth * velocity_.head<3>();
  if (!at_stamp.allFinite() || !(at_stamp.z() > kLeastDepthRatio)) return exposed;
  return {camera.projectLeft(at_stamp), exposed.disparity_px / at_stamp.z()};
}

Eigen::Vector3d RollingShutter::whenExposed(const StereoCamera& camera,
                                            const Eigen::Vector3d& p_camera) const {
  if (isGlobal() || !(p_camera.z() > 0.0)) return p_camera;
  // The row moves while the image is read out, by a small share of it: each time by that less.
  constexpr int kIterations = 3;
  Eigen::Vector3d exposed = p_camera;
  for (int i = 0; i < kIterations; ++i) {
    const double t = timeOf(camera, camera.projectLeft(exposed).y());
    exposed = expSO3(-t * velocity_.tail<3>()) * (p_camera - t * velocity_.head<3>());
    if (!exposed.allFinite() || !(exposed.z() > kLeastDepthRatio * p_camera.z())) return p_camera;
  }
  return exposed;
}

}  // namespace point_line_odometry
