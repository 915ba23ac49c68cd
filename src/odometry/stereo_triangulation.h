#pragma once

#include <optional>
#include <vector>

#include "common/thread_pool.h"
#include "matching/frame_matcher.h"
#include "matching/index_pair.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/frame_context.h"

namespace point_line_odometry {

/// Appends the points of stereo matches (left, right) to a frame: sub-pixel disparity
/// (matching/refine_subpixel), position and covariance. Those that cannot be triangulated are left
/// out.
void triangulatePoints(const std::vector<IndexPair>& matches, const FrameContext& context,
                       ThreadPool* threads, StereoFrame* frame);

/// Appends the lines of stereo matches (left, right) to a frame; those that cannot be triangulated
/// remain without a position.
void triangulateLines(const std::vector<IndexPair>& matches, const FrameContext& context,
                      StereoFrame* frame);

/// Both.
void triangulateMatches(const StereoMatches& matches, const FrameContext& context,
                        ThreadPool* threads, StereoFrame* frame);

/// The line at an observation; nothing if that cannot be triangulated.
std::optional<TriangulatedLine> triangulateObservation(const LineObservation& seen,
                                                       const FrameContext& context);

/// Locates the points and lines of a frame again, with another correction of the right image or
/// another velocity in its rolling shutter. What it cannot locate becomes as above.
void triangulateAgain(const FrameContext& context, StereoFrame* frame);

}  // namespace point_line_odometry
