#pragma once

#include <cstddef>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "point_line_odometry/features.h"
#include "point_line_odometry/image_pyramid.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// ORB points (Rublee et al. 2011), spread over the image: FAST corners, the strongest of each cell
/// (the paper's 50 x 50 px buckets), with orientation by intensity centroid and rotated BRIEF
/// descriptors on a smoothed image, whose pattern points/descriptor chooses.
class PointDetector {
 public:
  explicit PointDetector(const PointParameters& parameters);
  PointDetector(PointDetector&&) noexcept;
  PointDetector& operator=(PointDetector&&) noexcept;
  ~PointDetector();

  /// Features in reading order of the cells, per level; pixels in the full-resolution image. The
  /// image must be CV_8UC1.
  std::vector<PointFeature> detect(const cv::Mat& image);

  /// Those of the finest level alone, and those of all others.
  std::vector<PointFeature> detectFinest(const cv::Mat& image);
  std::vector<PointFeature> detectCoarser(const ImagePyramid& pyramid);

 private:
  struct Scratch;

  void detectLevel(const cv::Mat& image, int octave, std::vector<PointFeature>* features);
  void describe(const cv::Mat& image, std::size_t begin, std::vector<PointFeature>* features);

  PointParameters parameters_;
  std::unique_ptr<Scratch> scratch_;
};

}  // namespace point_line_odometry
