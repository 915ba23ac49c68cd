#pragma once

#include <cstdint>
#include <optional>

#include "matching/frame_matcher.h"
#include "odometry/odometry_state.h"
#include "odometry/tracking_result.h"
#include "point_line_odometry/frame_result.h"

namespace point_line_odometry {

/// Why the images of a frame are refused, kNone if they are not: they and their masks must be of
/// the camera, and newer than the last ones. \param last_stamp_ns of the last accepted frame.
TrackingReason refusal(const StereoImages& images, const StereoCamera& camera,
                       const std::optional<std::int64_t>& last_stamp_ns);

/// Fills a result with what was detected and tracked in a frame: reason, residuals, counts,
/// features.
/// \param state before its update by the frame.
void reportTracking(const OdometryState& state, const StereoFrame& curr,
                    const FrameContext& context, const TrackingResult& tracked,
                    FrameResult* result);

/// What became of a frame's prior: without a motion by the images it carries the pose while that is
/// predicted; relocalization uses none.
/// \param state after its update by the frame.
PriorReport reportPrior(const OdometryState& state, const TrackingResult& tracked,
                        const FramePrior& prior);

}  // namespace point_line_odometry
