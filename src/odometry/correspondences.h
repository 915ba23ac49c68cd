#pragma once

#include "point_line_odometry/calibration_refinement.h"
#include "point_line_odometry/matching.h"
#include "point_line_odometry/motion.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_odometry.h"

namespace point_line_odometry {

/// What the features of one frame are triangulated from. References.
struct TriangulationInput {
  const StereoMatches& matches;
  const StereoImages& images;
  const StereoCamera& camera;
  const RightImageCorrection& correction;  ///< of what is seen in the right image
  const Parameters& parameters;
};

/// Fills the points and lines of a frame from its stereo matches: sub-pixel disparity if asked for,
/// place in space and covariance. Points that cannot be triangulated are left out; lines stay
/// without a place.
void triangulateMatches(const TriangulationInput& input, ThreadPool* threads, StereoFrame* frame);

/// What the estimator needs of circular matches: places in the earlier frame and (sub-)pixels in
/// the current one, whose images these are. Element i of the points and lines belongs to element i
/// of the matches.
Correspondences makeCorrespondences(const StereoFrame& earlier, const StereoFrame& curr,
                                    const StereoImages& images, const CircularMatches& matches,
                                    const RightImageCorrection& correction,
                                    const Parameters& parameters);

/// Numbers of detected, stereo-matched and untriangulable features.
FrameCounts countFeatures(const StereoFrame& frame);

/// The features of the frame as they are shown: matched ones with their place, and the rest.
void observeFeatures(const StereoFrame& curr, const CircularMatches& matches,
                     const MotionEstimate& motion, FrameResult* result);

}  // namespace point_line_odometry
