#pragma once

#include <cstddef>
#include <vector>

#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// What is left out of the work on a frame.
struct FeatureBudget {
  double share = 1.0;            ///< of the configured numbers of features
  bool landmark_frames = false;  ///< every second frame may be tracked by landmarks alone
};

bool operator==(const FeatureBudget& a, const FeatureBudget& b);
bool operator!=(const FeatureBudget& a, const FeatureBudget& b);

/// Controls the feature budget so that frames take as long as a target, or less at the full budget.
/// Decides once in a few frames by the median of their times (of those with features and of those
/// tracked by landmarks alone by the mean of both medians, weighted by their numbers), so that a
/// single slow frame changes nothing: while that is above the target or below 0.9 of it, the share
/// of features is multiplied by 0.95 of the target over it, at least by 0.5 and at most by 1.25.
/// Before the share falls below 0.7, every second frame may be tracked by landmarks alone, until
/// frames with all features take less than 0.9 of the target. Reads no clock.
class AdaptiveFeatureBudget {
 public:
  static constexpr double kMinShare = 0.2;  ///< fewer features do not make a frame much cheaper
  static constexpr std::size_t kFramesPerDecision = 5;

  /// \param target_ms time that a frame may take; 0: the budget stays whole. Throws
  /// std::invalid_argument if it is negative or not finite.
  explicit AdaptiveFeatureBudget(double target_ms);

  /// Adds the time of a frame that was processed with the present budget. Returns the budget for
  /// the next one, its share kMinShare ... 1. Times that are negative or not finite are ignored.
  FeatureBudget addFrame(double frame_ms, bool by_landmarks = false);

  const FeatureBudget& budget() const { return budget_; }

 private:
  bool knowsEnough(bool by_landmarks) const;
  void decide(double mean_ms);

  double target_ms_;
  FeatureBudget budget_;
  std::vector<double> with_features_ms_;  // since the last decision
  std::vector<double> by_landmarks_ms_;
  bool begins_by_landmarks_ = false;
};

/// The parameters with the share of points/max_per_cell, lines/max_count and
/// lines/coarse_to_fine_points, at least one of each, and lines/min_gradient over it: time for
/// segments goes by the number of edge pixels, not by that of the segments that are kept. The
/// threshold of points stays, as FAST asks all pixels anyway, and without the weak ones dark images
/// have none. With them StereoOdometry::setParameters() keeps the previous frame and the map.
Parameters withFeatureBudget(Parameters parameters, const FeatureBudget& budget);

}  // namespace point_line_odometry
