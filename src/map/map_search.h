#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "common/thread_pool.h"
#include "map/landmarks.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/frame_context.h"

namespace point_line_odometry {

/// The landmarks in view of a frame, and their observations in it.
struct LandmarkMatches {
  struct Point {
    int landmark;  ///< index into the map's points
    PointObservation observation;
  };
  struct Line {
    int landmark;     ///< index into the map's lines
    int stereo_line;  ///< index into the frame's lines; -1: its edges were aligned
    LineObservation observation;
  };
  std::vector<Point> points;
  std::vector<Line> lines;
  std::vector<bool> point_in_view;  ///< one per point of the map
  std::vector<bool> line_in_view;   ///< one per line of the map
};

/// Matches points by projection: those observed in the last frame by aligning their patches at the
/// projections; the others by their descriptors first, as their projections may be less accurate.
/// \param threads null: the thread that calls.
void findPoints(const std::vector<MapPoint>& points, const Eigen::Isometry3d& T_camera_map,
                const StereoFrame& frame, const FrameContext& context, ThreadPool* threads,
                LandmarkMatches* landmark_matches);

/// Matches lines by projection, descriptors and geometry.
void findLines(const std::vector<MapLine>& lines, const Eigen::Isometry3d& T_camera_map,
               const StereoFrame& frame, const FrameContext& context, ThreadPool* threads,
               LandmarkMatches* landmark_matches);

/// The same without features of the frame: of the points observed in the last frame, which alone
/// count as in view.
void alignPoints(const std::vector<MapPoint>& points, const Eigen::Isometry3d& T_camera_map,
                 const FrameContext& context, ThreadPool* threads,
                 LandmarkMatches* landmark_matches);

/// The same for lines, by aligning their projections with the edges of the images.
void alignLines(const std::vector<MapLine>& lines, const Eigen::Isometry3d& T_camera_map,
                const FrameContext& context, ThreadPool* threads,
                LandmarkMatches* landmark_matches);

}  // namespace point_line_odometry
