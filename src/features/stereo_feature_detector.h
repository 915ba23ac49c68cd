#pragma once

#include <array>

#include "common/thread_pool.h"
#include "features/feature_mask.h"
#include "features/features.h"
#include "features/line_feature_detector.h"
#include "features/point_detector.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Detects and describes points and lines in both images of a stereo frame, in parallel.
class StereoFeatureDetector {
 public:
  /// Throws std::runtime_error if lines/detector is lsd and OpenCV has none.
  StereoFeatureDetector(const PointParameters& points, const LineParameters& lines);

  /// The detector of line segments in use: that of lines/detector, or its fallback.
  LineDetectorKind lineDetector() const { return line_detector_kind_; }

  /// The same result whatever the number of threads. Images must be CV_8UC1. \param masks of the
  /// images, which are painted by them; those of `images` are not used.
  DetectedFeatures detect(const StereoImages& images, LineResolution lines, ThreadPool* threads,
                          const StereoMasks& masks = {});

  /// Keypoints of the coarser levels of an image, which detect() leaves out: noise is averaged
  /// out there, and blurred texture has corners.
  /// \param mask with the levels of the pyramid. \param is_wanted as PointDetector's.
  std::vector<Keypoint> detectCoarserPoints(const ImagePyramid& image, ThreadPool* threads,
                                            const FeatureMask& mask,
                                            const PointDetector::IsWanted& is_wanted);

  /// The lines of both images in a coarser level, where the noise of an edge is less than its
  /// contrast; none if the images have no such level. \param masks with the levels of the pyramids.
  DetectedFeatures detectCoarserLines(const ImagePyramid& left, const ImagePyramid& right,
                                      ThreadPool* threads, const StereoMasks& masks = {});

 private:
  std::vector<LineFeature> detectCoarserLines(const ImagePyramid& image, const FeatureMask& mask,
                                              LineFeatureDetector* detector) const;

  bool points_enabled_;
  LineDetectorKind line_detector_kind_;
  std::array<PointDetector, 2> point_detectors_;       // left, right
  std::array<LineFeatureDetector, 2> line_detectors_;  // likewise
  int octave_of_coarser_lines_;
  std::array<LineFeatureDetector, 2> coarser_line_detectors_;
};

}  // namespace point_line_odometry
