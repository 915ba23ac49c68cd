#pragma once

#include <cstddef>
#include <vector>

#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Finds the feature budget with which frames take no longer than a target: the share of the
/// configured numbers of features that may be used. Decides once in a few frames by the median of
/// their times, so that a single slow frame changes nothing; lowers the budget at once as far as it
/// must, and raises it in small steps only while there is room for the next step. Knows no clock.
class ComputeGovernor {
 public:
  static constexpr double kMinBudget = 0.2;  ///< fewer features do not make a frame much cheaper
  static constexpr std::size_t kFramesPerDecision = 5;

  /// \param target_ms time that a frame may take; 0: the budget stays 1. Throws
  /// std::invalid_argument if it is negative or not finite.
  explicit ComputeGovernor(double target_ms);

  /// Takes the time of a frame that was processed with the present budget. Returns the budget for
  /// the next one, kMinBudget ... 1. Times that are negative or not finite are ignored.
  double addFrame(double frame_ms);

  double budget() const { return budget_; }

 private:
  double target_ms_;
  double budget_ = 1.0;
  std::vector<double> times_ms_;  // since the last decision
};

/// The parameters with a share, 0 ... 1, of points/max_per_cell and lines/max_count, at least one
/// of each. With them StereoOdometry::setParameters() goes on with reference and map.
Parameters withFeatureBudget(Parameters parameters, double share);

}  // namespace point_line_odometry
