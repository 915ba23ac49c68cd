#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "world/pixel_rays.h"
#include "world/sky.h"

namespace point_line_odometry::world {

/// The bonnet of the robot that carries the cameras, in the lower part of both images: a bent sheet
/// that is at rest in the left camera, with worn paint, stickers, scratches, bolts and gaps, and
/// glossy, so that it reflects the sky.
class Bonnet {
 public:
  /// \param rays of the left and the right camera. \param length 1: to 2.9 m ahead of the camera.
  /// \param margin_px by which its masks are larger than what is seen of it.
  Bonnet(const std::vector<PixelRays>& rays, const Eigen::Isometry3d& T_left_right, double length,
         std::uint32_t seed, int margin_px);

  /// Draws it into the light of a camera (0: left), CV_32FC1.
  void paint(std::size_t camera, const Eigen::Matrix3d& R_world_left, const Sky& sky,
             cv::Mat* light) const;

  /// CV_8UC1, 0 where a camera sees the bonnet, 255 elsewhere.
  const cv::Mat& mask(std::size_t camera) const { return views_[camera].mask; }

 private:
  struct Scratch {
    Eigen::Vector2f from;
    Eigen::Vector2f to;
  };
  struct View {
    cv::Mat cover;       // CV_32FC1, share of a pixel
    cv::Mat paint;       // CV_32FC1, light of the paint
    cv::Mat reflection;  // CV_32FC3, direction from which the gloss is lit, in the left camera
    cv::Mat mask;
  };

  View see(const PixelRays& rays, const Eigen::Isometry3d& T_left_camera, int margin_px) const;
  bool hit(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
           Eigen::Vector3f* p) const;
  float brightness(float x, float z) const;

  float front_;  // [m] ahead of the camera
  std::uint32_t seed_;
  std::vector<Scratch> scratches_;
  std::vector<View> views_;
};

}  // namespace point_line_odometry::world
