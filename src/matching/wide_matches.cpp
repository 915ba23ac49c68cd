#include "matching/wide_matches.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "features/point_detector.h"
#include "matching/descriptor_distance.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {
namespace {

/// For each keypoint the nearest descriptor within `band_px` rows that passes the ratio test, or
/// -1.
std::vector<int> bestPartners(const std::vector<Keypoint>& from, const std::vector<Keypoint>& to,
                              float band_px) {
  constexpr int kMaxDistance = 60;
  constexpr double kMaxRatio = 0.8;
  std::vector<int> partners;
  partners.reserve(from.size());
  for (const Keypoint& keypoint : from) {
    TwoNearest best;
    for (std::size_t i = 0; i < to.size(); ++i) {
      if (std::abs(to[i].pixel.y() - keypoint.pixel.y()) > band_px) continue;
      best.offer(static_cast<int>(i), hammingDistance(keypoint.descriptor, to[i].descriptor));
    }
    partners.push_back(best.accepted(kMaxDistance, kMaxRatio));
  }
  return partners;
}

}  // namespace

bool isMaskOf(const cv::Mat& mask, const cv::Mat& image) {
  return mask.type() == CV_8UC1 && mask.size() == image.size();
}

std::vector<Keypoint> detectUnmasked(const cv::Mat& image, const cv::Mat& mask) {
  PointParameters parameters;
  parameters.max_per_cell = 6;
  std::vector<Keypoint> keypoints = PointDetector(parameters).detect(image);
  if (!isMaskOf(mask, image)) return keypoints;
  constexpr int kPatch_px = 31;
  cv::Mat whole;  // 0 where a patch has a masked pixel
  cv::erode(mask, whole, cv::Mat::ones(kPatch_px, kPatch_px, CV_8U));
  const auto masked = [&](const Keypoint& keypoint) {
    const int x = std::clamp(cvRound(keypoint.pixel.x()), 0, image.cols - 1);
    const int y = std::clamp(cvRound(keypoint.pixel.y()), 0, image.rows - 1);
    return whole.at<std::uint8_t>(y, x) == 0;
  };
  keypoints.erase(std::remove_if(keypoints.begin(), keypoints.end(), masked), keypoints.end());
  return keypoints;
}

float wideBand_px(int rows) {
  constexpr float kShare = 1.0F / 6.0F;
  constexpr float kLeast_px = 32.0F;
  return std::max(kLeast_px, kShare * static_cast<float>(rows));
}

std::vector<std::pair<std::size_t, std::size_t>> matchInBand(const std::vector<Keypoint>& from,
                                                             const std::vector<Keypoint>& to,
                                                             float band_px) {
  const std::vector<int> forward = bestPartners(from, to, band_px);
  const std::vector<int> back = bestPartners(to, from, band_px);
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (forward[i] < 0) continue;
    const auto partner = static_cast<std::size_t>(forward[i]);
    if (back[partner] == static_cast<int>(i)) pairs.emplace_back(i, partner);
  }
  return pairs;
}

}  // namespace point_line_odometry
