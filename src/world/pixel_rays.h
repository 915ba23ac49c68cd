#pragma once

#include <opencv2/core.hpp>

#include "point_line_odometry/rectification.h"

namespace point_line_odometry::world {

/// A rectangle of pixels: columns x ... x + width - 1, rows y ... y + height - 1.
struct PixelBlock {
  int x = 0;
  int y = 0;
  int width = 0;
  int height = 0;
};

/// Bounds in the normalised image plane (z = 1).
struct PlaneBounds {
  float x_low = 0.0F;
  float x_high = 0.0F;
  float y_low = 0.0F;
  float y_high = 0.0F;
};

/// Directions (X, Y, 1) of the corners of all pixels of a camera: the corner (i, j) is the pixel
/// position (i - 0.5, j - 0.5).
class PixelRays {
 public:
  /// Rays of a camera's raw image through K and D, or of its rectified image through P. A pixel of
  /// an equidistant image more than 75 degrees off the axis sees what lies at 75 degrees.
  static PixelRays ofRawImage(const CameraCalibration& calibration);
  static PixelRays ofRectifiedImage(const CameraCalibration& calibration);

  int width() const { return corners_.cols - 1; }
  int height() const { return corners_.rows - 1; }

  const cv::Point2f& corner(int i, int j) const { return corners_(j, i); }

  /// Bounds of the directions that a block of pixels sees.
  PlaneBounds bounds(const PixelBlock& block) const;

  /// Whole image.
  PixelBlock all() const { return {0, 0, width(), height()}; }

 private:
  cv::Mat_<cv::Point2f> corners_;
  bool straight_ = true;  // no distortion: the corners of a block bound it
};

}  // namespace point_line_odometry::world
