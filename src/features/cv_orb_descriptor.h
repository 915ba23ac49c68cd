#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <vector>

#include "features/features.h"

namespace point_line_odometry {

/// ORB descriptors (Rublee et al. 2011) by OpenCV, with the pattern that its authors trained.
class CvOrbDescriptor {
 public:
  CvOrbDescriptor();

  /// Describes keypoints [begin, end of the list) of an image, whose pixels and angles are set.
  /// \param image CV_8UC1.
  void describe(const cv::Mat& image, std::size_t begin, std::vector<Keypoint>* keypoints);

 private:
  cv::Ptr<cv::ORB> orb_;
  std::vector<cv::KeyPoint> keypoints_;
  cv::Mat descriptors_;
};

}  // namespace point_line_odometry
