#pragma once

#include "common/thread_pool.h"
#include "matching/frame_matcher.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/frame_context.h"

namespace point_line_odometry {

/// Correspondences of circular matches for the motion estimate: positions in the earlier frame and
/// (sub-)pixels in the current one. Element i of the points and lines belongs to element i of the
/// matches.
/// \param T_curr_earlier as predicted, to warp patches. \param threads for the alignment of
/// patches, or null.
Correspondences makeCorrespondences(const StereoFrame& earlier, const StereoFrame& curr,
                                    const CircularMatches& matches,
                                    const Eigen::Isometry3d& T_curr_earlier,
                                    const FrameContext& context, ThreadPool* threads);

}  // namespace point_line_odometry
