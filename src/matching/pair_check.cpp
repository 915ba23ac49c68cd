#include "matching/pair_check.h"

#include <Eigen/Core>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "common/statistics.h"
#include "features/features.h"
#include "features/point_detector.h"
#include "matching/descriptor_distance.h"
#include "matching/patch_aligner.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {
namespace {

using Keypoints = std::vector<Keypoint>;

/// A match: pixels in both images.
struct PixelPair {
  Eigen::Vector2f left;
  Eigen::Vector2f right;

  float verticalDisparity() const { return right.y() - left.y(); }
  float disparity() const { return left.x() - right.x(); }
};

/// A mask of another size masks nothing.
bool isMaskOf(const cv::Mat& mask, const cv::Mat& image) {
  return mask.type() == CV_8UC1 && mask.size() == image.size();
}

/// Without keypoints whose patch has a masked pixel.
Keypoints detect(const cv::Mat& image, const cv::Mat& mask) {
  PointParameters parameters;
  parameters.max_per_cell = 6;
  Keypoints keypoints = PointDetector(parameters).detect(image);
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

/// For each keypoint the nearest descriptor within `band_px` rows that passes the ratio test, or
/// -1.
std::vector<int> bestPartners(const Keypoints& from, const Keypoints& to, float band_px) {
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

/// The pairs that pass the cross-check.
std::vector<PixelPair> matchInBand(const Keypoints& left, const Keypoints& right, float band_px) {
  const std::vector<int> to_right = bestPartners(left, right, band_px);
  const std::vector<int> to_left = bestPartners(right, left, band_px);
  std::vector<PixelPair> pairs;
  for (std::size_t i = 0; i < left.size(); ++i) {
    const int partner = to_right[i];
    if (partner < 0 || to_left[static_cast<std::size_t>(partner)] != static_cast<int>(i)) continue;
    pairs.push_back({left[i].pixel, right[static_cast<std::size_t>(partner)].pixel});
  }
  return pairs;
}

/// The mode of the vertical disparities, to a few pixels.
float commonVerticalDisparity(const std::vector<PixelPair>& pairs, float band_px) {
  constexpr float kWidthPx = 4.0F;
  const auto bin = [&](float difference) {
    return static_cast<std::size_t>((difference + band_px) / kWidthPx);
  };
  std::vector<int> counts(bin(band_px) + 2, 0);
  for (const PixelPair& pair : pairs) ++counts[bin(pair.verticalDisparity())];
  // Two bins at once, so that a peak at their border is not divided.
  std::size_t best = 0;
  for (std::size_t i = 0; i + 1 < counts.size(); ++i) {
    if (counts[i] + counts[i + 1] > counts[best] + counts[best + 1]) best = i;
  }
  return static_cast<float>(best + 1) * kWidthPx - band_px;
}

/// Vertical disparity as a plane over the left image: to first order the effect of a wrong pitch,
/// roll or focal length.
class VerticalDisparityPlane {
 public:
  VerticalDisparityPlane(float offset_px, cv::Size size)
      : centre_(0.5F * static_cast<float>(size.width), 0.5F * static_cast<float>(size.height)) {
    coefficients_[0] = offset_px;
  }

  std::vector<PixelPair> agreeing(const std::vector<PixelPair>& pairs, float tolerance_px) const {
    std::vector<PixelPair> kept;
    for (const PixelPair& pair : pairs) {
      const float residual = pair.verticalDisparity() - terms(pair).dot(coefficients_);
      if (std::abs(residual) <= tolerance_px) kept.push_back(pair);
    }
    return kept;
  }

  void fit(const std::vector<PixelPair>& pairs) {
    const auto rows = static_cast<Eigen::Index>(pairs.size());
    if (rows < 3) return;
    Eigen::MatrixX3f design(rows, 3);
    Eigen::VectorXf differences(rows);
    for (Eigen::Index i = 0; i < rows; ++i) {
      const PixelPair& pair = pairs[static_cast<std::size_t>(i)];
      design.row(i) = terms(pair).transpose();
      differences[i] = pair.verticalDisparity();
    }
    coefficients_ = design.colPivHouseholderQr().solve(differences);
  }

 private:
  Eigen::Vector3f terms(const PixelPair& pair) const {
    const Eigen::Vector2f p = (pair.left - centre_) / centre_.x();
    return {1.0F, p.x(), p.y()};
  }

  Eigen::Vector2f centre_;
  Eigen::Vector3f coefficients_ = Eigen::Vector3f::Zero();
};

/// The pairs whose vertical disparities agree with one plane; none if too few do.
std::vector<PixelPair> consistentPairs(const std::vector<PixelPair>& pairs, float band_px,
                                       cv::Size size) {
  constexpr std::array<float, 4> kTolerances_px{12.0F, 8.0F, 4.0F, 3.0F};
  constexpr std::size_t kMinShare = 4;  // at least 1 / 4 of the pairs
  VerticalDisparityPlane plane(commonVerticalDisparity(pairs, band_px), size);
  std::vector<PixelPair> kept;
  for (const float tolerance_px : kTolerances_px) {
    kept = plane.agreeing(pairs, tolerance_px);
    plane.fit(kept);
  }
  const bool enough =
      kept.size() >= PairMeasurement::kFewestMatches && kMinShare * kept.size() >= pairs.size();
  return enough ? kept : std::vector<PixelPair>();
}

/// Aligns right pixels to the patches around the left ones, where that converges.
void refine(const cv::Mat& left, const cv::Mat& right, std::vector<PixelPair>* pairs) {
  for (PixelPair& pair : *pairs) {
    const auto aligned = PatchAligner(left, pair.left).align(right, pair.right);
    if (aligned) pair.right = aligned->pixel;
  }
}

template <typename Value>
std::vector<float> valuesOf(const std::vector<PixelPair>& pairs, const Value& value) {
  std::vector<float> values;
  values.reserve(pairs.size());
  for (const PixelPair& pair : pairs) values.push_back(value(pair));
  return values;
}

/// Mean grey level around a pixel, not below 1.
double brightnessAround(const cv::Mat& image, const Eigen::Vector2f& pixel) {
  constexpr int kRadius_px = 4;
  const cv::Rect patch(cvRound(pixel.x()) - kRadius_px, cvRound(pixel.y()) - kRadius_px,
                       2 * kRadius_px + 1, 2 * kRadius_px + 1);
  const cv::Rect inside = patch & cv::Rect(0, 0, image.cols, image.rows);
  return inside.area() == 0 ? 1.0 : std::max(cv::mean(image(inside))[0], 1.0);
}

double contrastOf(const cv::Mat& image, const cv::Mat& mask) {
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(image, mean, deviation, isMaskOf(mask, image) ? mask : cv::Mat());
  return deviation[0];
}

bool areIdentical(const cv::Mat& left, const cv::Mat& right) {
  if (left.size() != right.size() || cv::norm(left, right, cv::NORM_INF) > 0.0) return false;
  double low = 0.0;
  double high = 0.0;
  cv::minMaxLoc(left, &low, &high);
  return high > low;
}

}  // namespace

PairMeasurement measurePair(const cv::Mat& left, const cv::Mat& right, const cv::Mat& left_mask,
                            const cv::Mat& right_mask) {
  constexpr float kBandShare = 1.0F / 6.0F;
  constexpr float kLeastBandPx = 32.0F;
  constexpr float kBehindInfinityPx = -1.0F;
  PairMeasurement measurement;
  for (const cv::Mat* image : {&left, &right}) {
    if (image->empty() || image->type() != CV_8UC1) return measurement;
  }
  const Keypoints left_keypoints = detect(left, left_mask);
  const Keypoints right_keypoints = detect(right, right_mask);
  measurement.keypoints_left = static_cast<int>(left_keypoints.size());
  measurement.keypoints_right = static_cast<int>(right_keypoints.size());
  measurement.contrast_left = contrastOf(left, left_mask);
  measurement.contrast_right = contrastOf(right, right_mask);
  measurement.identical = areIdentical(left, right);

  const float band_px = std::max(kLeastBandPx, kBandShare * static_cast<float>(left.rows));
  std::vector<PixelPair> pairs =
      consistentPairs(matchInBand(left_keypoints, right_keypoints, band_px), band_px, left.size());
  if (pairs.empty()) return measurement;
  refine(left, right, &pairs);
  const auto row = [](const PixelPair& pair) { return pair.verticalDisparity(); };
  const auto amount = [](const PixelPair& pair) { return std::abs(pair.verticalDisparity()); };
  const auto disparity = [](const PixelPair& pair) { return pair.disparity(); };
  measurement.matches = static_cast<int>(pairs.size());
  measurement.row_offset_px = median(valuesOf(pairs, row));
  measurement.vertical_disparity_px = median(valuesOf(pairs, amount));
  measurement.disparity_px = median(valuesOf(pairs, disparity));
  measurement.brightness_ratio = median(valuesOf(pairs, [&](const PixelPair& pair) {
    return static_cast<float>(brightnessAround(right, pair.right) /
                              brightnessAround(left, pair.left));
  }));
  const auto behind = std::count_if(pairs.begin(), pairs.end(), [&](const PixelPair& pair) {
    return pair.disparity() < kBehindInfinityPx;
  });
  measurement.behind_infinity_share =
      static_cast<double>(behind) / static_cast<double>(pairs.size());
  return measurement;
}

}  // namespace point_line_odometry
