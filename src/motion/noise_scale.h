#pragma once

#include <tuple>

#include "point_line_odometry/residual_histogram.h"

namespace point_line_odometry {

/// Variance factors of the noise of points and of lines relative to the parameters. They depend on
/// camera and scene, and are estimated from the residuals of the frames for each kind separately,
/// so that points and lines are weighted consistently (variance component estimation, Foerstner
/// 1979).
struct NoiseScale {
  double point_variance = 1.0;  ///< times that of the parameters
  double line_variance = 1.0;

  /// Updates the factors by the whitened residuals of a frame at this scale.
  void update(const ResidualHistogram& points, const ResidualHistogram& lines);

  auto state() {
    auto& [points, lines] = *this;
    return std::tie(points, lines);
  }
};

}  // namespace point_line_odometry
