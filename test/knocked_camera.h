#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// The images of a right camera that was turned since it was calibrated, about its x (pitch), y
/// (yaw) and z axis (roll).
inline StereoImages knocked(const StereoImages& images, const StereoCamera& camera,
                            const Eigen::Vector3d& rotation_deg) {
  Eigen::Matrix3d K;
  K << camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0;
  const Eigen::Vector3d rotation = rotation_deg * M_PI / 180.0;
  const Eigen::Matrix3d R =
      Eigen::AngleAxisd(rotation.norm(), rotation.stableNormalized()).toRotationMatrix();
  const Eigen::Matrix3d H = K * R * K.inverse();
  cv::Mat homography;
  cv::eigen2cv(H, homography);
  StereoImages turned = images;
  cv::Mat right;
  cv::warpPerspective(images.right, right, homography, images.right.size(), cv::INTER_LINEAR,
                      cv::BORDER_REPLICATE);
  turned.right = right;
  return turned;
}

}  // namespace point_line_odometry
