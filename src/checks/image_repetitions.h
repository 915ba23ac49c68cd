#pragma once

#include <opencv2/core.hpp>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Counts images of a sequence that are those of the last pair that was kept, byte for byte, as
/// from a driver that hangs or hands out a buffer twice. A camera without noise that is stationary
/// repeats both, for longer than a driver does: these are not counted.
class ImageRepetitions {
 public:
  /// Takes the next pair. Whether one of its images is repeated while the other is not: such a pair
  /// shows a wrong motion, and is not kept.
  bool add(const StereoImages& images);

  /// The next pair is the first of another sequence.
  void interrupt();

  /// Left images that were repeated.
  int left() const { return left_; }

  /// Right images that were repeated.
  int right() const { return right_; }

 private:
  cv::Mat last_left_;  // empty: the next pair follows none
  cv::Mat last_right_;
  int left_ = 0;
  int right_ = 0;
  int same_pairs_ = 0;  // in a row, of the latest ones
};

}  // namespace point_line_odometry
