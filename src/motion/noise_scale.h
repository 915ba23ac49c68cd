#pragma once

#include <tuple>

#include "point_line_odometry/motion.h"

namespace point_line_odometry {

/// How much larger the noise of points and of lines is than the parameters say. Cameras and scenes
/// differ: it is learnt from the residuals of the frames, for each kind on its own, so that neither
/// counts for more than it knows (estimation of variance components, Foerstner 1979).
struct NoiseScale {
  double point_variance = 1.0;  ///< times that of the parameters
  double line_variance = 1.0;

  /// Takes a frame into account: its residuals over their standard deviations at this scale.
  void learn(const ResidualHistogram& points, const ResidualHistogram& lines);

  auto state() {
    auto& [points, lines] = *this;
    return std::tie(points, lines);
  }
};

}  // namespace point_line_odometry
