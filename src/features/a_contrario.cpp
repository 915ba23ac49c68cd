#include "features/a_contrario.h"

#include <cmath>

namespace point_line_odometry {
namespace {

constexpr double kAlignedProbability = 1.0 / 8.0;  // of a random gradient, within +-22.5 deg
constexpr int kTableSize = 257;                    // segment lengths with a limit of their own

/// Least k with sum_{i >= k} C(n, i) p^i (1 - p)^(n - i) * 10^log10_tests <= 1; n + 1 if there is
/// none.
int fewestAlignedPixels(int n, double log10_tests) {
  const double log_p = std::log10(kAlignedProbability);
  const double log_q = std::log10(1.0 - kAlignedProbability);
  double log_binomial = 0.0;
  double false_alarms = 0.0;
  for (int k = n; k > 0; --k) {
    false_alarms += std::pow(10.0, log_binomial + k * log_p + (n - k) * log_q + log10_tests);
    if (false_alarms > 1.0) return k + 1;
    log_binomial += std::log10(static_cast<double>(k)) - std::log10(static_cast<double>(n - k + 1));
  }
  return 1;
}

}  // namespace

AContrarioTable::AContrarioTable(cv::Size image_size) : image_size_(image_size) {
  const double log10_tests = 2.5 * std::log10(static_cast<double>(image_size.area()));
  for (int n = 0; n < kTableSize; ++n) fewest_.push_back(fewestAlignedPixels(n, log10_tests));
}

bool AContrarioTable::meaningful(int n, int aligned) const {
  if (n < kTableSize) return aligned >= fewest_[n];
  // Beyond the table the share of its last entry is required, which is stricter.
  return static_cast<std::int64_t>(aligned) * (kTableSize - 1) >=
         static_cast<std::int64_t>(fewest_.back()) * n;
}

}  // namespace point_line_odometry
