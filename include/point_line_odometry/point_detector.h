#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "point_line_odometry/features.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// ORB points (Rublee et al. 2011), spread over the image: FAST corners, the strongest of each cell
/// (the paper's 50 x 50 px buckets), with orientation by intensity centroid and rotated BRIEF
/// descriptors on a smoothed image.
class PointDetector {
 public:
  explicit PointDetector(const PointParameters& parameters);

  /// Features in reading order of the cells, per level; pixels in the full-resolution image. The
  /// image must be CV_8UC1.
  std::vector<PointFeature> detect(const cv::Mat& image) const;

 private:
  static constexpr int kRotations = 30;
  static constexpr int kBits = 256;

  struct Comparison {
    cv::Point first;
    cv::Point second;
  };
  using Pattern = std::array<Comparison, kBits>;

  void detectLevel(const cv::Mat& image, int octave, std::vector<PointFeature>* features) const;
  Descriptor describe(const cv::Mat& smooth, cv::Point centre, float angle_rad) const;

  PointParameters parameters_;
  std::array<Pattern, kRotations> patterns_;  // the BRIEF pattern turned by multiples of 12 deg
};

}  // namespace point_line_odometry
