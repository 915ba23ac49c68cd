#include "point_line_odometry/residual_histogram.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace point_line_odometry {

void ResidualHistogram::add(double value) {
  const double bin = std::floor(value / kBinWidth) + kMiddle;
  ++counts[static_cast<std::size_t>(std::clamp(bin, 0.0, kBins - 1.0))];
  squares += value * value;
}

void ResidualHistogram::add(const ResidualHistogram& other) {
  for (std::size_t i = 0; i < counts.size(); ++i) counts[i] += other.counts[i];
  squares += other.squares;
}

std::int64_t ResidualHistogram::size() const {
  return std::accumulate(counts.begin(), counts.end(), std::int64_t{0});
}

double ResidualHistogram::variance() const {
  return squares / static_cast<double>(std::max(size(), std::int64_t{1}));
}

}  // namespace point_line_odometry
