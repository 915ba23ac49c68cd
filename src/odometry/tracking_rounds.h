#pragma once

#include "common/thread_pool.h"
#include "matching/stereo_frame.h"
#include "motion/frame_context.h"
#include "odometry/odometry_state.h"
#include "odometry/tracking_result.h"
#include "point_line_odometry/frame_result.h"

namespace point_line_odometry {

/// What a stereo pair shows, and the motion to it.
struct TrackedFrame {
  FrameContext context;
  StereoFrame frame;
  TrackingResult tracking;
};

/// Tracks the frame. What a rolling shutter shows depends on the velocity, which the frame's motion
/// tells better than it was predicted: where it shows the features elsewhere, they are located and
/// tracked again. So are those of a previous frame whose own motion was not known.
/// \param state its previous frame is located again then. \param tracked receives the tracking
/// result; context and frame the shutter with which it was found.
void trackWithShutter(const FramePrior& prior, ThreadPool* threads, OdometryState* state,
                      TrackedFrame* tracked, StageTimes* times);

/// Where a motion shows that the right camera was knocked, the landmarks of both frames are wrong,
/// and so is the motion itself: it is estimated again with the correction that it shows. It shows
/// more of it then: so again, until that is known as well as a calibrated camera's, or a few times.
/// \param state its previous frame is located again then, and its maps are dropped. \param tracked
/// receives evidence, correction and result; a correction with which there is no motion is undone.
void recalibrate(const FramePrior& prior, ThreadPool* threads, OdometryState* state,
                 TrackedFrame* tracked, StageTimes* times);

}  // namespace point_line_odometry
