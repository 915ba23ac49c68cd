#pragma once

#include "motion/sights.h"
#include "point_line_odometry/matching.h"
#include "point_line_odometry/motion.h"
#include "point_line_odometry/stereo_odometry.h"

namespace point_line_odometry {

/// Fills the points and lines of a frame from its stereo matches: sub-pixel disparity if asked for,
/// place in space and covariance. Points that cannot be triangulated are left out; lines stay
/// without a place.
void triangulateMatches(const StereoMatches& matches, const FrameContext& context,
                        ThreadPool* threads, StereoFrame* frame);

/// What the estimator needs of circular matches: places in the earlier frame and (sub-)pixels in
/// the current one. Element i of the points and lines belongs to element i of the matches.
/// \param T_curr_earlier as predicted: how patches change on the way. \param threads to share the
/// alignment of patches out, or null.
Correspondences makeCorrespondences(const StereoFrame& earlier, const StereoFrame& curr,
                                    const CircularMatches& matches,
                                    const Eigen::Isometry3d& T_curr_earlier,
                                    const FrameContext& context, ThreadPool* threads);

/// Numbers of detected, stereo-matched and untriangulable features.
FrameCounts countFeatures(const StereoFrame& frame);

/// The features of the frame as they are shown: matched ones with their place, and the rest.
void observeFeatures(const StereoFrame& curr, const CircularMatches& matches,
                     const MotionEstimate& motion, FrameResult* result);

}  // namespace point_line_odometry
