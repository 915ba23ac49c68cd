#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <vector>

#include "point_line_odometry/features.h"

namespace point_line_odometry {

/// Descriptors of ORB (Rublee et al. 2011) with the pattern that its authors have learnt, by
/// OpenCV.
class CvOrbDescriptor {
 public:
  CvOrbDescriptor();

  /// Describes features [begin, end of the list) of an image, whose pixels and angles are known.
  /// \param image CV_8UC1.
  void describe(const cv::Mat& image, std::size_t begin, std::vector<PointFeature>* features);

 private:
  cv::Ptr<cv::ORB> orb_;
  std::vector<cv::KeyPoint> keypoints_;
  cv::Mat descriptors_;
};

}  // namespace point_line_odometry
