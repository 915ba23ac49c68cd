#include "checks/wide_matches.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "features/point_detector.h"
#include "matching/cross_check.h"
#include "matching/descriptor_distance.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {
namespace {

/// Keypoints in the order of their rows.
struct RowsOfKeypoints {
  std::vector<int> indices;  // in the list that was given
  std::vector<float> rows_px;
  std::vector<Descriptor> descriptors;

  explicit RowsOfKeypoints(const std::vector<Keypoint>& keypoints) : indices(keypoints.size()) {
    std::iota(indices.begin(), indices.end(), 0);
    const auto row = [&](int i) { return keypoints[static_cast<std::size_t>(i)].pixel.y(); };
    std::stable_sort(indices.begin(), indices.end(), [&](int a, int b) { return row(a) < row(b); });
    for (const int i : indices) {
      rows_px.push_back(row(i));
      descriptors.push_back(keypoints[static_cast<std::size_t>(i)].descriptor);
    }
  }
};

/// For each keypoint the nearest descriptor within `band_px` rows that passes the ratio test, or
/// -1.
std::vector<int> bestPartners(const std::vector<Keypoint>& from, const std::vector<Keypoint>& to,
                              float band_px) {
  constexpr int kMaxDistance = 60;
  constexpr double kMaxRatio = 0.8;
  const RowsOfKeypoints candidates(to);
  const std::vector<float>& rows_px = candidates.rows_px;
  std::vector<int> sequence(to.size());
  std::iota(sequence.begin(), sequence.end(), 0);
  std::vector<int> distances(to.size());
  std::vector<int> partners;
  partners.reserve(from.size());
  for (const Keypoint& keypoint : from) {
    const float row_px = keypoint.pixel.y();
    const auto first = std::lower_bound(rows_px.begin(), rows_px.end(), row_px - band_px);
    const auto last = std::upper_bound(first, rows_px.end(), row_px + band_px);
    const auto begin = static_cast<std::size_t>(first - rows_px.begin());
    const auto count = static_cast<std::size_t>(last - first);
    hammingDistances(keypoint.descriptor, candidates.descriptors.data(), sequence.data() + begin,
                     static_cast<int>(count), distances.data());
    TwoNearest best;
    for (std::size_t k = 0; k < count; ++k) best.offer(candidates.indices[begin + k], distances[k]);
    partners.push_back(best.accepted(kMaxDistance, kMaxRatio));
  }
  return partners;
}

/// As many cells in a large image as in one of usual size.
int cellSize_px(cv::Size size) {
  constexpr double kUsual_px = 0.5e6;
  constexpr int kLargest_px = 400;
  const int usual_px = PointParameters().cell_size_px;
  const double ratio = std::sqrt(static_cast<double>(size.area()) / kUsual_px);
  return std::clamp(cvRound(ratio * usual_px), usual_px, kLargest_px);
}

}  // namespace

bool isMaskOf(const cv::Mat& mask, const cv::Mat& image) {
  return mask.type() == CV_8UC1 && mask.size() == image.size();
}

std::vector<Keypoint> detectUnmasked(const cv::Mat& image, const cv::Mat& mask) {
  PointParameters parameters;
  parameters.max_per_cell = 6;
  parameters.cell_size_px = cellSize_px(image.size());
  return PointDetector(parameters)
      .detect(image, FeatureMask(isMaskOf(mask, image) ? mask : cv::Mat()));
}

float wideBand_px(int rows) {
  constexpr float kShare = 1.0F / 6.0F;
  constexpr float kLeast_px = 32.0F;
  return std::max(kLeast_px, kShare * static_cast<float>(rows));
}

std::vector<IndexPair> matchInBand(const std::vector<Keypoint>& from,
                                   const std::vector<Keypoint>& to, float band_px) {
  return crossCheck(bestPartners(from, to, band_px), bestPartners(to, from, band_px));
}

}  // namespace point_line_odometry
