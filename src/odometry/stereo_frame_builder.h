#pragma once

#include <optional>

#include "common/thread_pool.h"
#include "features/stereo_feature_detector.h"
#include "matching/stereo_frame.h"
#include "motion/frame_context.h"
#include "odometry/coarser_points.h"
#include "point_line_odometry/frame_result.h"

namespace point_line_odometry {

/// Adds the coarser levels of the images and of their masks to the context.
void addLevels(FrameContext* context, ThreadPool* threads);

/// A stereo frame with the features detected in both images, not matched yet.
StereoFrame detectFeatures(StereoFeatureDetector* detector, LineResolution lines,
                           const FrameContext& context, ThreadPool* threads, StageTimes* times);

/// Matches the features of a frame left with right and triangulates. Where the image has few
/// points, coarser levels of the pyramid are used, too. \param start nothing without a previous
/// frame. If that has points of coarser levels, the context and the frame get the levels in which
/// they are aligned.
StereoFrame matchFeatures(StereoFrame frame, StereoFeatureDetector* detector,
                          const std::optional<TrackingStart>& start, FrameContext* context,
                          ThreadPool* threads, StageTimes* times);

}  // namespace point_line_odometry
