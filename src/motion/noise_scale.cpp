#include "motion/noise_scale.h"

#include <algorithm>

namespace point_line_odometry {
namespace {

constexpr double kUpdateRate = 0.05;     // of the mean, for a frame with many residuals
constexpr double kFewResiduals = 100.0;  // with this number it is half of that
constexpr double kLargestScale = 4.0;    // of the variance; 1 / 4 is the smallest

void updateFrom(const ResidualHistogram& residuals, double* variance) {
  const auto size = static_cast<double>(residuals.size());
  if (size == 0.0) return;
  const double share = kUpdateRate * size / (size + kFewResiduals);
  const double updated = *variance * (1.0 + share * (residuals.variance() - 1.0));
  *variance = std::clamp(updated, 1.0 / kLargestScale, kLargestScale);
}

}  // namespace

void NoiseScale::update(const ResidualHistogram& points, const ResidualHistogram& lines) {
  updateFrom(points, &point_variance);
  updateFrom(lines, &line_variance);
}

}  // namespace point_line_odometry
