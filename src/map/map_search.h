#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "map/landmarks.h"
#include "motion/sights.h"
#include "point_line_odometry/thread_pool.h"

namespace point_line_odometry {

/// Which landmarks a frame should see, and where it does.
struct MapSights {
  struct Point {
    int landmark;  ///< index into the map's points
    PointSight sight;
  };
  struct Line {
    int landmark;     ///< index into the map's lines
    int stereo_line;  ///< index into the frame's lines
    LineSight sight;
  };
  std::vector<Point> points;
  std::vector<Line> lines;
  std::vector<bool> point_in_view;  ///< one per point of the map
  std::vector<bool> line_in_view;   ///< one per line of the map
};

/// Looks for points by projection: those seen in the last frame by their patches from the expected
/// places; the others by their descriptors first, as they may be farther off.
void findPoints(const std::vector<MapPoint>& points, const Eigen::Isometry3d& T_camera_map,
                const StereoFrame& frame, const FrameContext& context, ThreadPool* threads,
                MapSights* sights);

/// Looks for lines by projection, by their descriptors and geometry.
void findLines(const std::vector<MapLine>& lines, const Eigen::Isometry3d& T_camera_map,
               const StereoFrame& frame, const FrameContext& context, MapSights* sights);

}  // namespace point_line_odometry
