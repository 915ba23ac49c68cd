#pragma once

#include "common/thread_pool.h"
#include "odometry/odometry_state.h"
#include "odometry/tracking_result.h"

namespace point_line_odometry {

/// Tracks a frame against the previous one and the map; after a gap in the stamps it first tries to
/// relocalize in the map. While there is a lost map, relocalization tries that, too (every half
/// second while the camera is tracked, each frame otherwise). A pose that the camera cannot have
/// reached since the last frame is rejected. \param prior of the frame's motion.
TrackingResult trackOrRelocalize(const OdometryState& state, const StereoFrame& curr,
                                 const FramePrior& prior, const FrameContext& context,
                                 ThreadPool* threads, StageTimes* times);

}  // namespace point_line_odometry
