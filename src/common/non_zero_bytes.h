#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>

namespace point_line_odometry {

/// Calls visit(i) for each of bytes[begin] ... bytes[end - 1] that is not zero. Eight zeros are
/// skipped at once; up to seven bytes behind the end are read.
template <typename Visit>
void forEachNonZero(const std::uint8_t* bytes, int begin, int end, Visit&& visit) {
  for (int i = begin; i < end; i += 8) {
    std::uint64_t eight = 0;
    std::memcpy(&eight, bytes + i, sizeof(eight));
    if (eight == 0) continue;
    for (int k = i; k < std::min(i + 8, end); ++k) {
      if (bytes[k] != 0) visit(k);
    }
  }
}

}  // namespace point_line_odometry
