#pragma once

#include <string>
#include <vector>

namespace point_line_odometry {

inline std::string join(const std::vector<std::string>& words, const std::string& separator) {
  std::string joined;
  for (const std::string& word : words) joined += (joined.empty() ? "" : separator) + word;
  return joined;
}

}  // namespace point_line_odometry
