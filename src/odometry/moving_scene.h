#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "common/thread_pool.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/frame_context.h"
#include "odometry/tracking_result.h"

namespace point_line_odometry {

/// \file
/// What rests in the left image between two frames, what moves through it, and the motion of the
/// camera on which the latter agrees.

/// A near point of the previous frame that was matched with the current one.
struct MatchedPoint {
  int prev;                   ///< index in the previous frame
  PointCorrespondence point;  ///< sigma_px: a pixel of its level
  double shift_px;            ///< by which it has moved in the left image [px of its level]
};

/// A scene that moves through the image.
struct MovingScene {
  Eigen::Isometry3d T_curr_prev;  ///< of the camera, by the scene
  std::vector<double> depths;     ///< of the points that it explains, in the previous frame [m]
};

/// Pixel of a point in the left image.
const Eigen::Vector2f& leftPixel(const StereoFrame& frame, const StereoPoint& point);

/// Pixels of the image per pixel of a point's level.
double levelScaleOf(const StereoFrame& frame, const StereoPoint& point,
                    const FrameContext& context);

/// The distance between the left pixels at which two motions show a point of the previous frame [px
/// of its level], of a far one by their rotations alone; infinite if one takes it out of view.
double shiftBetween(const StereoFrame& prev, const StereoPoint& point,
                    const Eigen::Isometry3d& T_curr_prev, const Eigen::Isometry3d& other,
                    const FrameContext& context);

/// Inliers of the motion from frame to frame, at the pixels to which they were aligned; none
/// without a motion.
std::vector<MatchedPoint> matchedInliers(const TrackingResult& tracked, const StereoFrame& prev,
                                         const FrameContext& context);

/// Matches by appearance, in the whole image, of points that are not among those that `tracked`
/// has matched as inliers, at the pixels where they were detected.
std::vector<MatchedPoint> matchOthers(const StereoFrame& prev, const StereoFrame& curr,
                                      const TrackingResult& tracked, const FrameContext& context,
                                      ThreadPool* threads);

/// The motion on which points agree that have moved by `least_px` (RANSAC, then least squares).
/// Nothing unless it explains 30 % of them and kMinConsensus: leaves less than a quarter of their
/// squared shift. The noise of what rests moves points, too, but no motion explains that.
std::optional<MovingScene> findMovingScene(const std::vector<MatchedPoint>& matches,
                                           double least_px, const FrameContext& context);

}  // namespace point_line_odometry
