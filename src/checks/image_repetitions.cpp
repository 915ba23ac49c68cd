#include "checks/image_repetitions.h"

#include "common/same_image.h"

namespace point_line_odometry {

bool ImageRepetitions::add(const StereoImages& images) {
  constexpr int kMostByDriver = 2;
  const bool left = isSameImage(images.left, last_left_);
  const bool right = isSameImage(images.right, last_right_);
  if (left && right) {
    ++same_pairs_;
    return false;
  }
  if (same_pairs_ <= kMostByDriver) {
    left_ += same_pairs_;
    right_ += same_pairs_;
  }
  same_pairs_ = 0;
  if (left) ++left_;
  if (right) ++right_;
  if (left || right) return true;
  last_left_ = images.left.clone();
  last_right_ = images.right.clone();
  return false;
}

void ImageRepetitions::interrupt() {
  last_left_ = last_right_ = cv::Mat();
  same_pairs_ = 0;
}

}  // namespace point_line_odometry
