#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "world/pixel_rays.h"
#include "world/scene.h"

namespace point_line_odometry::world {

/// A camera with its pose, and the rows of its image that are asked for.
struct View {
  const PixelRays* rays = nullptr;
  Eigen::Isometry3d T_world_camera = Eigen::Isometry3d::Identity();
  cv::Range rows = cv::Range::all();
};

/// Light that reaches every pixel of every view, as CV_32FC1 images of its rows (1: a white surface
/// in full light). `movers` are drawn with the scene's own instances.
///
/// Visibility is determined by halving blocks of pixels until one surface covers a block and hides
/// all others there (Warnock 1969), so no thin surface is missed; a pixel with more than one
/// surface is the mean of 16 rays. Both views are rendered on all cores.
std::vector<cv::Mat> render(const Scene& scene, const std::vector<Instance>& movers,
                            const std::vector<View>& views);

}  // namespace point_line_odometry::world
