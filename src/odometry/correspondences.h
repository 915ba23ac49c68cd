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

/// Where the left image is short of stereo points, in its cells of points/cell_size_px.
class PointCoverage {
 public:
  PointCoverage(const StereoFrame& frame, const FrameContext& context);

  /// Whether it is worth while to look for more.
  bool isPoor() const;

  /// Whether the cell of a pixel is short of points.
  bool isShortAt(const Eigen::Vector2f& pixel) const { return counts_[cellOf(pixel)] < kFew; }

 private:
  static constexpr int kFew = 2;

  std::size_t cellOf(const Eigen::Vector2f& pixel) const;

  float cell_size_;
  std::size_t columns_;
  std::vector<int> counts_;
};

/// Whether some of a frame's points were detected in coarser levels.
bool hasCoarserPoints(const StereoFrame& frame);

/// Adds points that were detected in coarser levels of the pyramid, where the frame is short of
/// stereo points: matches and triangulates them.
void addCoarserPoints(const DetectedFeatures& coarser, const PointCoverage& coverage,
                      const FrameContext& context, ThreadPool* threads, StereoFrame* frame);

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
