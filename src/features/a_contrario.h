#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace point_line_odometry {

/// Smallest number of aligned pixels with which a segment of n pixels is meaningful: its number of
/// false alarms is at most 1 in the a-contrario model of von Gioi et al. 2010.
class AContrarioTable {
 public:
  AContrarioTable() = default;
  explicit AContrarioTable(cv::Size image_size);

  /// \param n pixels of the segment. \param aligned those whose gradient is within 22.5 deg of the
  /// segment's normal.
  bool meaningful(int n, int aligned) const;

  cv::Size imageSize() const { return image_size_; }

 private:
  cv::Size image_size_;
  std::vector<int> fewest_;
};

}  // namespace point_line_odometry
