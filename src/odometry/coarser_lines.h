#pragma once

#include "common/thread_pool.h"
#include "features/stereo_feature_detector.h"
#include "matching/stereo_frame.h"
#include "motion/frame_context.h"

namespace point_line_odometry {

/// Adds the lines of a coarser level of the images (StereoFeatureDetector::detectCoarserLines()) to
/// a frame with few points: in the dark, edges are below the noise of single pixels, too. They are
/// matched with each other. An edge that the frame has a line of is left out: it would count twice.
/// The context must have the levels.
void addCoarserLines(StereoFeatureDetector* detector, const FrameContext& context,
                     ThreadPool* threads, StereoFrame* frame);

}  // namespace point_line_odometry
