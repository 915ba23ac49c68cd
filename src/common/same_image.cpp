#include "common/same_image.h"

#include <cstddef>
#include <cstring>

namespace point_line_odometry {

bool haveSameBytes(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size()) return false;
  for (int y = 0; y < a.rows; ++y) {
    if (std::memcmp(a.ptr(y), b.ptr(y), static_cast<std::size_t>(a.cols)) != 0) return false;
  }
  return true;
}

bool isSameImage(const cv::Mat& a, const cv::Mat& b) {
  if (a.empty() || !haveSameBytes(a, b)) return false;
  double low = 0.0;
  double high = 0.0;
  cv::minMaxLoc(a, &low, &high);
  return high > low;
}

}  // namespace point_line_odometry
