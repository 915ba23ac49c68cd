#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "common/thread_pool.h"
#include "features/feature_mask.h"
#include "features/features.h"
#include "features/image_pyramid.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Keypoints, bucketed: FAST corners in the image itself, the strongest of each cell (the paper's
/// 50 x 50 px buckets), and corners of detectCoarserCorners() in the coarser levels of its pyramid;
/// with orientation by intensity centroid and rotated BRIEF descriptors on a smoothed image (ORB,
/// Rublee et al. 2011), whose pattern points/descriptor selects.
class PointDetector {
 public:
  using IsWanted = std::function<bool(const Keypoint&)>;

  explicit PointDetector(const PointParameters& parameters);
  PointDetector(PointDetector&&) noexcept;
  PointDetector& operator=(PointDetector&&) noexcept;
  ~PointDetector();

  /// Keypoints of all levels in the order of octaves, within one in reading order of the cells;
  /// pixels in the full-resolution image. The image must be CV_8UC1.
  std::vector<Keypoint> detect(const cv::Mat& image, const FeatureMask& mask = {});

  /// Those of the finest level only, and those of all others.
  /// \param mask with the levels of the pyramid.
  std::vector<Keypoint> detectFinest(const cv::Mat& image, const FeatureMask& mask = {});
  /// \param is_wanted whether a corner, which has no descriptor yet, is kept.
  std::vector<Keypoint> detectCoarser(const ImagePyramid& pyramid, ThreadPool* threads = nullptr,
                                      const FeatureMask& mask = {},
                                      const IsWanted& is_wanted = nullptr);

 private:
  struct Scratch;

  void describe(const cv::Mat& image, std::size_t begin, std::vector<Keypoint>* keypoints);

  PointParameters parameters_;
  std::unique_ptr<Scratch> scratch_;
};

}  // namespace point_line_odometry
