#pragma once

#include <array>
#include <opencv2/core/mat.hpp>
#include <string>

#include "point_line_odometry/rectification.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// The name that means no file.
constexpr const char* kNoMask = "none";

/// Mask files of the left and the right camera, or kNoMask.
using MaskFiles = std::array<std::string, 2>;

/// Masks of both cameras that do not change, from files: images as the camera takes them (before
/// rectification), pixels that are 0 are ignored.
class StaticMasks {
 public:
  StaticMasks() = default;
  /// Throws InputError if a file is not an image of 8 bit; of colours, black is 0.
  explicit StaticMasks(const MaskFiles& files);

  /// One sentence on a mask that has not the size of its camera; empty if both fit.
  std::string sizeFault(const StereoCalibration& calibration) const;

  /// Adds the masks to those that the images have: what one of them ignores is ignored. Sizes must
  /// agree.
  void addTo(StereoImages* images) const;

 private:
  MaskFiles files_{kNoMask, kNoMask};
  std::array<cv::Mat, 2> masks_;
};

/// What one of two masks of the same size ignores; either may be empty.
cv::Mat combineMasks(const cv::Mat& a, const cv::Mat& b);

}  // namespace point_line_odometry
