#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "point_line_odometry/features.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Four features that are one thing in the world: indices into the feature lists of the four images. For points and lines alike.
struct CircularMatch {
  int prev_left = -1;
  int prev_right = -1;
  int curr_right = -1;
  int curr_left = -1;
};

struct CircularMatches {
  std::vector<CircularMatch> points;
  std::vector<CircularMatch> lines;
};

/// Right partner of each left feature of one stereo frame (index, or -1), and the left partner of each right one.
struct StereoMatches {
  std::vector<int> points_right_of_left;
  std::vector<int> points_left_of_right;
  std::vector<int> lines_right_of_left;
  std::vector<int> lines_left_of_right;
};

/// Left-right legs of the circle for one stereo frame: best descriptor within the epipolar window delta_u x delta_v.
StereoMatches matchStereo(const StereoFeatures& features, const MatchingParameters& parameters);

/// Walks l(k-1) -> r(k-1) -> r(k) -> l(k) -> l(k-1) and keeps what ends where it began (paper, section 2).
/// \param T_curr_prev predicted motion from the velocity (paper, eq. 1); without one, identity and the wider radius are used.
CircularMatches matchCircular(const StereoFeatures& prev, const StereoMatches& prev_stereo, const StereoFeatures& curr,
                              const StereoMatches& curr_stereo, const StereoCamera& camera,
                              const std::optional<Eigen::Isometry3d>& T_curr_prev,
                              const MatchingParameters& parameters);

}  // namespace point_line_odometry
