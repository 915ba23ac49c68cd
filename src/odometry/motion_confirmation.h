#pragma once

#include <vector>

#include "map/local_map.h"
#include "matching/stereo_frame.h"
#include "motion/frame_context.h"
#include "motion/motion_estimator.h"
#include "odometry/tracking_result.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// \file
/// How much of what an estimated motion brings into view is found there: wrong matches may agree on
/// a motion, but the rest of the scene does not confirm it.

/// With a correct prediction at least this share of the features is matched (0.35 and more in all
/// sequences at full rate).
constexpr double kShareFound = 0.25;

/// [px of a point's level] What moves by less rests. Of the features in view a stationary camera
/// finds half to three quarters in the dark, and more elsewhere; a moving one that is taken for
/// stationary found up to 0.61, unless it is slow.
constexpr double kRests_px = 1.0;
constexpr double kShareStationary = 0.65;

/// With a wrong prediction at most this share seems to be found (0.064 at every 6th frame of
/// EuRoC). So where more agree on a plausible motion, these are the scene, and a larger part of the
/// image that moves otherwise is not.
constexpr double kShareOfScene = 0.1;

/// Share of an earlier frame's features in view after the motion from frame to frame that were
/// matched and are inliers; 0 without a motion. Far points are left out: they agree with any
/// translation.
double shareFound(const StereoFrame& earlier, const StereoCamera& camera,
                  const TrackingResult& tracked);

/// Share of the matches from frame to frame that are inliers: near where a wrong motion projects
/// the features there may be much that looks alike, but less of it agrees on the motion. 0 without
/// one.
double shareAgreeing(const TrackingResult& tracked);

/// At least this share of the matches agrees with a right first motion: of 305 in built-in scenes,
/// many of them hard, 12 have less, 5 of which are wrong by more than six of their standard
/// deviations, as are 5 of the others; of 396 in the shared sequences 3 have less.
constexpr double kShareAgreeing = 0.6;

/// For each match of points whether it is of a far point that has not moved in the left image, if
/// these may hold the motion from frame to frame against the scene: they are many of the inliers,
/// more features that have a depth should be in view, and too few of these are found for a
/// stationary camera. Empty otherwise. Text that a camera writes into both images is such.
std::vector<bool> restingThatMayHold(const StereoFrame& earlier, const StereoFrame& curr,
                                     const FrameContext& context, const TrackingResult& tracked);

/// Whether they held the motion, by the result without them (`freed`): more of the scene is found
/// by that, or hardly any of it by the other; then `freed` counts, with or without a motion.
bool isFreed(const StereoFrame& earlier, const StereoCamera& camera, const TrackingResult& held,
             const TrackingResult& freed);

/// True if wrong matches agreed on the motion: few features of the previous frame are found at it,
/// and of the landmarks far fewer, compared with the frames before and with the features. Where
/// something hides most of the scene, as many landmarks are found as features. Where most inliers
/// are far points, as on top of a hill, the translation is the prediction's.
/// \param history with a previous frame and a map.
bool isRefuted(const TrackingResult& tracked, const FrameHistory& history,
               const StereoCamera& camera);

/// True if not significantly more of the scene is found at a motion than at one on which wrong
/// matches agree, for one that neither a velocity nor a prior supports. Where most inliers are far
/// points, the translation is not theirs.
bool isByChance(const StereoFrame& earlier, const StereoCamera& camera,
                const TrackingResult& tracked);

/// At a right motion the share of landmarks found is at least this fraction of that in the frames
/// before (in all sequences that are never lost), and of the share of features found. At another
/// place with similar appearance at most 0.48 is (of 3960 tries in corridors, rooms and plaster 510
/// gave a wrong motion; those that were not ambiguous anyway had at most 0.41), and at most 0.31 of
/// the features.
constexpr double kShareConfirmed = 0.5;

/// What relocalization needs, which has no motion from frame to frame.
constexpr double kShareRecognized = 0.7;

/// At a right motion, of the landmarks of a scene most of which something hides in this frame.
constexpr double kShareMostlyHidden = 1.0 / 3.0;

/// True if most of the landmarks that the last frame observed are found again and agree with the
/// motion, and these are not too few: the frame may do without features of its own.
bool isFoundAgain(const TrackingResult& tracked);

/// True if landmarks should be found at a motion, and at least a fraction of the usual share is.
bool isConfirmed(const LocalMap& map, const LandmarkMatches& landmark_matches,
                 const MotionEstimate& motion, double least);

/// The same, by as many landmarks as tell one place from another that looks alike, of which only a
/// part is found.
bool isPlaceRecognized(const LocalMap& map, const LandmarkMatches& landmark_matches,
                       const MotionEstimate& motion, double least);

}  // namespace point_line_odometry
