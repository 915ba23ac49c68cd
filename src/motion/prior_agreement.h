#pragma once

namespace point_line_odometry {

/// Beyond this share of rejected priors their source is suspended: after three in a row, until a
/// dozen have agreed.
constexpr double kMaxRejectedShare = 0.25;

/// Updates the share of rejected priors, that of about the ten latest ones that were compared.
inline void updateRejectedShare(bool agreed, double* share) {
  constexpr double kMemory = 10.0;
  *share += ((agreed ? 0.0 : 1.0) - *share) / kMemory;
}

}  // namespace point_line_odometry
