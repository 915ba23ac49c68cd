#pragma once

#include <cstddef>
#include <vector>

#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Controls the feature budget, the share of the configured numbers of features that may be used,
/// so that frames take as long as a target, or less at the full budget. Decides once in a few
/// frames by the median of their times (of those with features and of those tracked by landmarks
/// alone by the mean of both medians, weighted by their numbers), so that a single slow frame
/// changes nothing: while that is above the target or below 0.9 of it, the budget is multiplied by
/// 0.95 of the target over it, at least by 0.5 and at most by 1.25. Reads no clock.
class AdaptiveFeatureBudget {
 public:
  static constexpr double kMinBudget = 0.2;  ///< fewer features do not make a frame much cheaper
  static constexpr std::size_t kFramesPerDecision = 5;

  /// \param target_ms time that a frame may take; 0: the budget stays 1. Throws
  /// std::invalid_argument if it is negative or not finite.
  explicit AdaptiveFeatureBudget(double target_ms);

  /// Adds the time of a frame that was processed with the present budget. Returns the budget for
  /// the next one, kMinBudget ... 1. Times that are negative or not finite are ignored.
  double addFrame(double frame_ms, bool by_landmarks = false);

  double budget() const { return budget_; }

 private:
  double target_ms_;
  double budget_ = 1.0;
  std::vector<double> with_features_ms_;  // since the last decision
  std::vector<double> by_landmarks_ms_;
  bool begins_by_landmarks_ = false;
};

/// The parameters with a share, 0 ... 1, of points/max_per_cell and lines/max_count, at least one
/// of each, and lines/min_gradient over it: time for segments goes by the number of edge pixels,
/// not by that of the segments that are kept. The threshold of points stays, as FAST asks all
/// pixels anyway, and without the weak ones dark images have none. With them
/// StereoOdometry::setParameters() keeps the previous frame and the map.
Parameters withFeatureBudget(Parameters parameters, double share);

}  // namespace point_line_odometry
