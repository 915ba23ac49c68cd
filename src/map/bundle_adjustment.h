#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "map/landmarks.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Keyframes and the landmarks that they see: all values, so that it can be solved beside other
/// work.
struct BundleProblem {
  struct Frame {
    std::uint64_t id = 0;
    Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
    bool fixed = false;
  };

  template <typename Place, typename Sight>
  struct Landmark {
    struct FrameSight {
      int frame;  ///< index into frames
      Sight sight;
    };
    std::uint64_t id = 0;
    Place place;
    std::vector<FrameSight> sights;
    bool culled = false;  ///< by adjustBundle(): its place is wrong
  };

  /// A motion between two frames that is known from elsewhere.
  struct Motion {
    int from;  ///< index into frames
    int to;    ///< index into frames
    Eigen::Isometry3d T_from_to;
    Matrix6d covariance;  ///< of T_from_to, along and about the axes of `to`
  };

  std::vector<Frame> frames;
  std::vector<Motion> motions;
  std::vector<Landmark<PointBelief, PointSight>> points;
  std::vector<Landmark<LineBelief, LineSight>> lines;

  bool hasLandmarks() const { return !points.empty() || !lines.empty(); }
};

/// Minimises the point-line reprojection errors of all sights, with Huber kernels, and the errors
/// of the motions, over the frames that are not fixed and the landmarks, by Levenberg-Marquardt;
/// landmarks are eliminated first (Schur complement). The spreads of the landmarks stay as they
/// are: they scale the unknowns. A landmark that is behind a camera that sees it, or whose
/// residuals there are not finite, is culled: the solution goes without it. Returns false, and
/// changes nothing else, if there is nothing to solve or no solution.
bool adjustBundle(const StereoCamera& camera, const MotionParameters& parameters,
                  int max_iterations, BundleProblem* problem);

}  // namespace point_line_odometry
