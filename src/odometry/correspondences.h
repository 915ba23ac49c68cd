#pragma once

#include "common/thread_pool.h"
#include "matching/frame_matcher.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/frame_context.h"
#include "motion/motion_estimator.h"

namespace point_line_odometry {

/// Correspondences of circular matches for the motion estimate: positions in the earlier frame and
/// (sub-)pixels in the current one. Element i of the points and lines belongs to element i of the
/// matches.
/// \param T_curr_earlier by which patches are warped. \param threads for the alignment of patches,
/// or null.
Correspondences makeCorrespondences(const StereoFrame& earlier, const StereoFrame& curr,
                                    const CircularMatches& matches,
                                    const Eigen::Isometry3d& T_curr_earlier,
                                    const FrameContext& context, ThreadPool* threads);

/// Correspondences of some 100 points of an earlier frame, from all over its image, without
/// features of the current frame: patches of the coarsest octave are aligned where a motion
/// predicts them, up to 2.5 px of that octave away. Accurate to a fraction of a pixel of that
/// octave, which is enough for alignments in the image itself. \param earlier_image the earlier
/// frame's left image with the octaves of the context's images.
Correspondences alignCoarsely(const StereoFrame& earlier, const ImagePyramid& earlier_image,
                              const Eigen::Isometry3d& T_curr_earlier, const FrameContext& context,
                              ThreadPool* threads);

/// Whether the warps of a tenth of an estimate's inlier points differ by more than 2 % of a patch's
/// size, in scale, roll or shear, from those by which they were aligned: the alignment is biased
/// towards these. \param T_curr_earlier by which patches were warped.
bool warpsDiffer(const StereoFrame& earlier, const CircularMatches& matches,
                 const MotionEstimate& motion, const Eigen::Isometry3d& T_curr_earlier,
                 const StereoCamera& camera);

}  // namespace point_line_odometry
