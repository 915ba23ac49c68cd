#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "map/landmarks.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Keyframes and the landmarks that they observe: a value, so that it can be solved in parallel to
/// other work.
struct BundleProblem {
  struct Frame {
    std::uint64_t id = 0;
    Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
    bool fixed = false;
  };

  template <typename Estimate, typename Observation>
  struct Landmark {
    struct FrameObservation {
      int frame;  ///< index into frames
      Observation observation;
    };
    std::uint64_t id = 0;
    Estimate estimate;
    std::vector<FrameObservation> observations;
    bool culled = false;  ///< by adjustBundle(): its position is invalid
  };

  /// A relative-pose constraint between two frames.
  struct Motion {
    int from;  ///< index into frames
    int to;    ///< index into frames
    Eigen::Isometry3d T_from_to;
    Matrix6d covariance;  ///< of T_from_to, along and about the axes of `to`
  };

  std::vector<Frame> frames;
  std::vector<Motion> motions;
  std::vector<Landmark<PointEstimate, PointObservation>> points;
  std::vector<Landmark<LineEstimate, LineObservation>> lines;

  bool hasLandmarks() const { return !points.empty() || !lines.empty(); }
};

/// Minimises the point-line reprojection errors of all observations, with a Huber loss, and the
/// errors of the motions, over the frames that are not fixed and the landmarks, by
/// Levenberg-Marquardt; landmarks are eliminated first (Schur complement). The covariances of the
/// landmarks are not changed: they scale the parameters. A landmark that is behind a camera that
/// observes it, or whose residuals there are not finite, is culled and left out. Returns false, and
/// changes nothing else, if there is nothing to solve or no solution.
bool adjustBundle(const StereoCamera& camera, const MotionParameters& parameters,
                  int max_iterations, BundleProblem* problem);

}  // namespace point_line_odometry
