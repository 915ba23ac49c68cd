#include "motion/noise_scale.h"

#include <algorithm>

namespace point_line_odometry {
namespace {

constexpr double kShareOfFrame = 0.05;   // of a frame with many residuals in what is learnt
constexpr double kFewResiduals = 100.0;  // with so many it is half of that
constexpr double kLargestScale = 4.0;    // and its inverse: twice or half the standard deviation

void learnFrom(const ResidualHistogram& residuals, double* variance) {
  const auto size = static_cast<double>(residuals.size());
  if (size == 0.0) return;
  const double share = kShareOfFrame * size / (size + kFewResiduals);
  const double learnt = *variance * (1.0 + share * (residuals.variance() - 1.0));
  *variance = std::clamp(learnt, 1.0 / kLargestScale, kLargestScale);
}

}  // namespace

void NoiseScale::learn(const ResidualHistogram& points, const ResidualHistogram& lines) {
  learnFrom(points, &point_variance);
  learnFrom(lines, &line_variance);
}

}  // namespace point_line_odometry
