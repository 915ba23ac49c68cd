#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "map/landmarks.h"
#include "point_line_odometry/matching.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Where new points may be taken: the image in cells, each of which wants a number of points.
class PointQuota {
 public:
  PointQuota(const StereoCamera& camera, int cell_size_px);

  /// A point that is there already; it must lie in the image.
  void occupy(const Eigen::Vector2f& pixel) { cell(pixel).push_back(pixel); }

  /// Takes a pixel if its cell has fewer points than wanted, and no other is near.
  bool take(const Eigen::Vector2f& pixel, int wanted);

 private:
  std::vector<Eigen::Vector2f>& cell(const Eigen::Vector2f& pixel);

  float cell_size_;
  int columns_;
  std::vector<std::vector<Eigen::Vector2f>> cells_;
};

/// True if the patch that a point of the map keeps lies in the image.
bool patchFits(const Eigen::Vector2f& pixel, const StereoCamera& camera);

/// A landmark at the place and with the looks of a point of a frame at a pose.
MapPoint makePoint(const StereoFrame& frame, const StereoPoint& stereo,
                   const Eigen::Isometry3d& T_map_camera);

/// The same for a line, which must be triangulated.
MapLine makeLine(const StereoFrame& frame, const StereoLine& stereo,
                 const Eigen::Isometry3d& T_map_camera);

}  // namespace point_line_odometry
