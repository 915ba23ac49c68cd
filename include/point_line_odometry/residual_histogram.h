#pragma once

#include <array>
#include <cstdint>

namespace point_line_odometry {

/// Histogram of the coordinates of whitened residuals: normal with unit variance if the covariances
/// are right, but for the outliers that were removed.
struct ResidualHistogram {
  static constexpr double kBinWidth = 0.25;  ///< [standard deviations]
  static constexpr int kBins = 40;           ///< the outermost contain all beyond them, too
  static constexpr int kMiddle = kBins / 2;  ///< the bin that begins at 0

  std::array<std::int64_t, kBins> counts{};  ///< of coordinates, for each bin
  double squares = 0.0;                      ///< sum over all coordinates

  /// Adds a coordinate [standard deviations].
  void add(double value);
  /// Adds all that another one has.
  void add(const ResidualHistogram& other);
  std::int64_t size() const;  ///< number of coordinates
  double variance() const;    ///< about zero mean; 0 without coordinates
};

}  // namespace point_line_odometry
