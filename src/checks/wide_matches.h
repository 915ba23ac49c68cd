#pragma once

/// \file
/// Matches of points between images of which little is known: by descriptors alone.

#include <opencv2/core.hpp>
#include <vector>

#include "features/features.h"
#include "matching/index_pair.h"

namespace point_line_odometry {

/// A mask of another size or type masks nothing.
bool isMaskOf(const cv::Mat& mask, const cv::Mat& image);

/// Keypoints of a CV_8UC1 image, at most some thousands; nothing of them depends on masked pixels.
std::vector<Keypoint> detectUnmasked(const cv::Mat& image, const cv::Mat& mask);

/// Rows [px] within which a point is looked for in an image that may be badly rectified, or taken
/// some time later: a sixth of the height.
float wideBand_px(int rows);

/// The pairs (index in `from`, index in `to`) at most `band_px` rows apart, in any columns, whose
/// descriptors are nearest to each other in both directions, by far.
std::vector<IndexPair> matchInBand(const std::vector<Keypoint>& from,
                                   const std::vector<Keypoint>& to, float band_px);

}  // namespace point_line_odometry
