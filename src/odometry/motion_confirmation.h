#pragma once

#include "map/local_map.h"
#include "matching/stereo_frame.h"
#include "motion/motion_estimator.h"
#include "odometry/frame_tracker.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// \file
/// How much of what an estimated motion brings into view is found there: wrong matches may agree on
/// a motion, but the rest of the scene does not confirm it.

/// With a correct prediction at least this share of the features is matched (0.35 and more in all
/// sequences at full rate).
constexpr double kShareFound = 0.25;

/// Share of an earlier frame's features in view after the motion from frame to frame that were
/// matched and are inliers; 0 without a motion. Far points are left out: they agree with any
/// translation.
double shareFound(const StereoFrame& earlier, const StereoCamera& camera,
                  const TrackingResult& tracked);

/// True if wrong matches agreed on the motion: few features of the previous frame are found at it,
/// and of the landmarks far fewer, compared with the frames before and with the features. Where
/// something hides most of the scene, as many landmarks are found as features. Where most inliers
/// are far points, as on top of a hill, the translation is the prediction's.
/// \param history with a previous frame and a map.
bool isRefuted(const TrackingResult& tracked, const FrameHistory& history,
               const StereoCamera& camera);

/// True if the share of landmarks in view that is found is nearly that of consecutive frames: of
/// another place with similar appearance only a part is found.
bool isPlaceRecognized(const LocalMap& map, const LandmarkMatches& landmark_matches,
                       const MotionEstimate& motion);

}  // namespace point_line_odometry
