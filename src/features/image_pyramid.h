#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// An image and smaller copies of it, each pixel the mean of those that it covers, which averages
/// out noise. A level's index is its octave; that of the image itself is 0.
struct ImagePyramid {
  std::vector<cv::Mat> levels;  ///< CV_8UC1, the finest first

  ImagePyramid() = default;

  /// The image alone; it is shared, not copied.
  explicit ImagePyramid(const cv::Mat& image) : levels{image} {}

  /// The image with its levels.
  ImagePyramid(const cv::Mat& image, const PointParameters& parameters) : ImagePyramid(image) {
    addLevels(parameters);
  }

  /// Adds the coarser levels; those too small for a keypoint are left out.
  void addLevels(const PointParameters& parameters);

  /// Pixels of the image per pixel of a level, along x and y.
  Eigen::Array2f ratio(int octave) const;

  /// From pixels of the image to those of a level, and back. Integer pixels are centres: pixel i of
  /// a level is centred at (i + 0.5) * ratio - 0.5 in the image.
  Eigen::Vector2f toLevel(const Eigen::Vector2f& pixel, int octave) const {
    return (pixel.array() + 0.5F) / ratio(octave) - 0.5F;
  }
  Eigen::Vector2f fromLevel(const Eigen::Vector2f& pixel, int octave) const {
    return (pixel.array() + 0.5F) * ratio(octave) - 0.5F;
  }
};

}  // namespace point_line_odometry
