#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "common/cell_grid.h"
#include "map/landmarks.h"
#include "matching/frame_matcher.h"
#include "matching/stereo_frame.h"
#include "motion/motion_estimator.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Features of a frame from which landmarks may be created, by their indices in the frame.
struct LandmarkCandidates {
  std::vector<int> points;  ///< inliers of the motion from the previous frame
  std::vector<int> lines;   ///< the same
  /// Points not matched with the previous frame: they came into view, or their appearance has
  /// changed.
  std::vector<int> unmatched_points;
};

/// \param matches (previous, current) \param motion estimated from them; nothing without one.
LandmarkCandidates landmarkCandidates(const StereoFrame& curr, const CircularMatches& matches,
                                      const MotionEstimate& motion);

/// Bucketing of the points of the map: the image in cells with a limited number of points each.
class PointBuckets {
 public:
  PointBuckets(const StereoCamera& camera, int cell_size_px);

  /// Adds an existing point; it must lie in the image.
  void occupy(const Eigen::Vector2f& pixel) { cells_.at(pixel).push_back(pixel); }

  /// Adds a pixel if its cell has fewer points than wanted, and no other is near; returns whether
  /// it did.
  bool take(const Eigen::Vector2f& pixel, int wanted);

 private:
  CellGrid<std::vector<Eigen::Vector2f>> cells_;
};

/// True if the patch that a point of the map keeps lies in the image.
bool patchFits(const Eigen::Vector2f& pixel, const StereoCamera& camera);

/// A landmark from a stereo point of a frame at a pose.
MapPoint makePoint(const StereoFrame& frame, const StereoPoint& stereo, const StereoCamera& camera,
                   const Eigen::Isometry3d& T_map_camera);

/// The same for a line, which must be triangulated.
MapLine makeLine(const StereoFrame& frame, const StereoLine& stereo,
                 const Eigen::Isometry3d& T_map_camera);

}  // namespace point_line_odometry
