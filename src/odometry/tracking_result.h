#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <tuple>

#include "map/local_map.h"
#include "matching/frame_matcher.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/motion_estimator.h"
#include "motion/online_stereo_calibration.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/motion_prior.h"

namespace point_line_odometry {

/// Frame k-2, for the fusion of rotations.
struct FrameBeforePrevious {
  StereoFrame frame;
  Eigen::Isometry3d T_previous_before = Eigen::Isometry3d::Identity();  ///< motion k-2 -> k-1

  auto state() {
    auto& [frame_of_this, T] = *this;
    return std::tie(frame_of_this, T);
  }
};

/// What earlier frames leave to track the next one against.
struct FrameHistory {
  std::optional<StereoFrame> previous;  ///< frame k-1: the last one that can be matched with
  std::optional<FrameBeforePrevious> before_previous;  ///< frame k-2, if rotations are fused
  std::optional<LocalMap> map;                         ///< nothing without a window

  auto state() {
    auto& [previous_of_this, before, map_of_this] = *this;
    return std::tie(previous_of_this, before, map_of_this);
  }
};

/// Result of tracking a frame: its motion since the previous frame.
struct TrackingResult {
  TrackingReason reason = TrackingReason::kNone;  ///< kNone: the motion was estimated
  CircularMatches matches;                        ///< (previous, current)
  Correspondences correspondences;                ///< of these
  MotionEstimate frame_to_frame;                  ///< from these only
  /// Another motion that may as well be right, unless a velocity or a prior supports this one.
  std::optional<Eigen::Isometry3d> T_curr_prev_other;
  MotionEstimate motion;  ///< the best one: against the map if there is one
  /// Of `motion`'s kind, by the images alone; nothing if they give none.
  std::optional<ImageMotion> image_motion;
  PriorReport prior;
  LandmarkMatches landmark_matches;
  /// The motion is against landmarks alone: the frame's features were not detected, and
  /// correspondences are those of the landmark matches.
  bool by_landmarks = false;
  /// What frame_to_frame says about the right camera.
  std::optional<CalibrationEvidence> calibration;
  /// The motion has weakly constrained axes, for which it was fused with the prediction.
  bool weak = false;
  /// Another motion is possible, which the covariance covers, too: the features found may rest on
  /// the robot's own body, repeat themselves, agree by chance, or be of another place.
  bool ambiguous = false;
  /// `motion` is from relocalization: landmarks matched by descriptors over the whole image.
  bool relocalized = false;
  bool in_lost_map = false;     ///< relocalized in the lost map: `motion` is since its last frame
  bool tried_lost_map = false;  ///< relocalization in the lost map failed
};

}  // namespace point_line_odometry
