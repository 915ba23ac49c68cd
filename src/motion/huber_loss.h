#pragma once

#include <cmath>

namespace point_line_odometry {

/// Huber's loss of a residual with squared norm s: rho(s) / 2, and the derivative of rho by s, by
/// which squares of the residual are weighted (iteratively reweighted least squares).
struct HuberLoss {
  double cost;
  double weight = 1.0;

  /// \param delta norm from which on the loss grows linearly.
  HuberLoss(double squared_norm, double delta) : cost(0.5 * squared_norm) {
    if (!(squared_norm > delta * delta)) return;
    const double norm = std::sqrt(squared_norm);
    cost = delta * (norm - 0.5 * delta);
    weight = delta / norm;
  }
};

}  // namespace point_line_odometry
