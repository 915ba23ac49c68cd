#include "checks/pair_check.h"

#include <Eigen/Core>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "checks/lens_check.h"
#include "checks/wide_matches.h"
#include "common/same_image.h"
#include "common/statistics.h"
#include "features/features.h"
#include "matching/patch_aligner.h"

namespace point_line_odometry {
namespace {

/// A match: pixels in both images.
struct PixelPair {
  Eigen::Vector2f left;
  Eigen::Vector2f right;

  float verticalDisparity() const { return right.y() - left.y(); }
  float disparity() const { return left.x() - right.x(); }
};

std::vector<PixelPair> pixelPairs(const std::vector<Keypoint>& left,
                                  const std::vector<Keypoint>& right, float band_px) {
  std::vector<PixelPair> pairs;
  for (const auto& [l, r] : matchInBand(left, right, band_px)) {
    pairs.push_back({left[l].pixel, right[r].pixel});
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

}  // namespace

PairMeasurement measurePair(const cv::Mat& left, const cv::Mat& right, const cv::Mat& left_mask,
                            const cv::Mat& right_mask) {
  constexpr float kBehindInfinityPx = -1.0F;
  PairMeasurement measurement;
  for (const cv::Mat* image : {&left, &right}) {
    if (image->empty() || image->type() != CV_8UC1) return measurement;
  }
  const std::vector<Keypoint> left_keypoints = detectUnmasked(left, left_mask);
  const std::vector<Keypoint> right_keypoints = detectUnmasked(right, right_mask);
  measurement.keypoints_left = static_cast<int>(left_keypoints.size());
  measurement.keypoints_right = static_cast<int>(right_keypoints.size());
  measurement.contrast_left = contrastOf(left, left_mask);
  measurement.contrast_right = contrastOf(right, right_mask);
  measurement.identical = isSameImage(left, right);

  if (left.size() == right.size()) {
    const LensMeasurement lenses =
        measureLenses(left, right, isMaskOf(left_mask, left) ? left_mask : cv::Mat(),
                      isMaskOf(right_mask, right) ? right_mask : cv::Mat());
    measurement.obscured_left = lenses.left_share;
    measurement.obscured_right = lenses.right_share;
  }

  const float band_px = wideBand_px(left.rows);
  std::vector<PixelPair> pairs =
      consistentPairs(pixelPairs(left_keypoints, right_keypoints, band_px), band_px, left.size());
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
