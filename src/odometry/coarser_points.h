#pragma once

#include <Eigen/Core>
#include <optional>

#include "common/cell_grid.h"
#include "common/thread_pool.h"
#include "features/stereo_feature_detector.h"
#include "matching/expected_features.h"
#include "matching/stereo_frame.h"
#include "motion/frame_context.h"

namespace point_line_odometry {

/// \file
/// Points of the pyramid's coarser levels, for frames whose images have few points: dark or plain
/// ones. Averaging over a level's pixels and correlating whole patches find texture that is below
/// the noise of single pixels.

/// Number of stereo points in each cell (points/cell_size_px) of the left image. Cells that are
/// mostly masked do not count.
class PointCoverage {
 public:
  PointCoverage(const StereoFrame& frame, const FrameContext& context);

  /// Whether too many cells have few points.
  bool isPoor() const;

  /// Whether the cell of a pixel has few points.
  bool isShortAt(const Eigen::Vector2f& pixel) const { return counts_.at(pixel) < few_; }

 private:
  static constexpr int kMasked = -1;

  void leaveOutMasked(const FrameContext& context);

  CellGrid<int> counts_;
  int few_;
};

/// The frame from which points are tracked, and the predicted motion since then.
struct TrackingStart {
  const StereoFrame& previous;
  MotionPrediction prediction;
};

/// Whether some of a frame's points were detected in coarser levels.
bool hasCoarserPoints(const StereoFrame& frame);

/// Adds points of coarser levels to a frame where it has few stereo points: those of the previous
/// frame are tracked, new corners are detected, and both are matched by correlation. The context
/// must have the levels.
void addCoarserPoints(StereoFeatureDetector* detector, const std::optional<TrackingStart>& start,
                      const PointCoverage& coverage, const FrameContext& context,
                      ThreadPool* threads, StereoFrame* frame);

}  // namespace point_line_odometry
