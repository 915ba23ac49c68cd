#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "common/thread_pool.h"
#include "matching/frame_matcher.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/frame_context.h"
#include "odometry/tracking_result.h"

namespace point_line_odometry {

/// \file
/// What moves through the left image between two frames, and the motion on which it agrees, if that
/// is another one than the most features have.

/// A scene that moves through the image while others rest.
struct MovingScene {
  Eigen::Isometry3d T_curr_prev;  ///< of the camera, by the scene
  std::vector<double> depths;     ///< of the points that agree on it, in the previous frame [m]
};

const Eigen::Vector2f& leftPixel(const StereoFrame& frame, const StereoPoint& point);

/// Pixels of the image per pixel of a point's level.
double levelScaleOf(const StereoFrame& frame, const StereoPoint& point,
                    const FrameContext& context);

/// By how much a matched point has moved in the left image [px of the point's level].
double shiftOf(const IndexPair& match, const StereoFrame& prev, const StereoFrame& curr,
               const FrameContext& context);

/// By how much a motion moves a point in the left image [px of the point's level], a far one by its
/// rotation alone; infinite if it takes the point out of view.
double expectedShift(const StereoFrame& prev, const StereoPoint& point,
                     const Eigen::Isometry3d& T_curr_prev, const FrameContext& context);

/// Inliers of the motion from frame to frame, (previous, current), without far points.
std::vector<IndexPair> inliersOf(const TrackingResult& tracked, const StereoFrame& prev);

/// Matches by appearance, in the whole image, of the points that are not among the inliers.
std::vector<IndexPair> matchOthers(const StereoFrame& prev, const StereoFrame& curr,
                                   const std::vector<IndexPair>& inliers,
                                   const MatchingParameters& parameters, ThreadPool* threads);

/// Those of the inliers from frame to frame that do not rest, at the pixels to which they were
/// aligned: where two motions differ by little, one may take the inliers of the other.
std::vector<PointCorrespondence> movingInliers(const TrackingResult& tracked,
                                               const StereoFrame& prev,
                                               const FrameContext& context);

/// Those of the matches that do not rest.
std::vector<PointCorrespondence> movingMatches(const std::vector<IndexPair>& matches,
                                               const StereoFrame& prev, const StereoFrame& curr,
                                               const FrameContext& context);

/// The motion on which a third of the moving points agree; nothing if fewer do, or if it explains
/// less than half of how they move: the noise of what rests moves points, too.
std::optional<MovingScene> findMovingScene(const std::vector<PointCorrespondence>& moving,
                                           const FrameContext& context);

}  // namespace point_line_odometry
