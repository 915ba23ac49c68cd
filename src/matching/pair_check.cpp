#include "point_line_odometry/pair_check.h"

#include <Eigen/Core>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "common/statistics.h"
#include "matching/descriptor_distance.h"
#include "point_line_odometry/matching.h"
#include "point_line_odometry/point_detector.h"

namespace point_line_odometry {
namespace {

using Features = std::vector<PointFeature>;

/// Pixels of one thing in both images.
struct PixelPair {
  Eigen::Vector2f left;
  Eigen::Vector2f right;

  float rowDifference() const { return right.y() - left.y(); }
  float disparity() const { return left.x() - right.x(); }
};

Features detect(const cv::Mat& image) {
  PointParameters parameters;
  parameters.max_per_cell = 6;
  return PointDetector(parameters).detect(image);
}

/// For each feature its best partner within `band_px` rows, or -1.
std::vector<int> bestPartners(const Features& from, const Features& to, float band_px) {
  constexpr int kMaxDistance = 60;
  constexpr double kMaxRatio = 0.8;
  std::vector<int> partners;
  partners.reserve(from.size());
  for (const PointFeature& feature : from) {
    BestTwo best;
    for (std::size_t i = 0; i < to.size(); ++i) {
      if (std::abs(to[i].pixel.y() - feature.pixel.y()) > band_px) continue;
      best.offer(static_cast<int>(i), hammingDistance(feature.descriptor, to[i].descriptor));
    }
    partners.push_back(best.accepted(kMaxDistance, kMaxRatio));
  }
  return partners;
}

/// Pairs of which each is the other's best.
std::vector<PixelPair> matchInBand(const Features& left, const Features& right, float band_px) {
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

/// The row difference that most pairs have, to a few pixels.
float commonRowDifference(const std::vector<PixelPair>& pairs, float band_px) {
  constexpr float kWidthPx = 4.0F;
  const auto bin = [&](float difference) {
    return static_cast<std::size_t>((difference + band_px) / kWidthPx);
  };
  std::vector<int> counts(bin(band_px) + 2, 0);
  for (const PixelPair& pair : pairs) ++counts[bin(pair.rowDifference())];
  // Of two bins at once: a peak between them is as good as one in the middle.
  std::size_t best = 0;
  for (std::size_t i = 0; i + 1 < counts.size(); ++i) {
    if (counts[i] + counts[i + 1] > counts[best] + counts[best + 1]) best = i;
  }
  return static_cast<float>(best + 1) * kWidthPx - band_px;
}

/// Row difference as a plane over the left image: what a wrong pitch, roll or focal length does.
class RowPlane {
 public:
  RowPlane(float offset_px, cv::Size size)
      : centre_(0.5F * static_cast<float>(size.width), 0.5F * static_cast<float>(size.height)) {
    coefficients_[0] = offset_px;
  }

  std::vector<PixelPair> agreeing(const std::vector<PixelPair>& pairs, float tolerance_px) const {
    std::vector<PixelPair> kept;
    for (const PixelPair& pair : pairs) {
      const float residual = pair.rowDifference() - terms(pair).dot(coefficients_);
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
      differences[i] = pair.rowDifference();
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

/// The pairs whose row differences change smoothly over the image; none if too few do.
std::vector<PixelPair> consistentPairs(const std::vector<PixelPair>& pairs, float band_px,
                                       cv::Size size) {
  constexpr std::array<float, 4> kTolerances_px{12.0F, 8.0F, 4.0F, 3.0F};
  constexpr std::size_t kLeastShare = 4;  // one of so many
  RowPlane plane(commonRowDifference(pairs, band_px), size);
  std::vector<PixelPair> kept;
  for (const float tolerance_px : kTolerances_px) {
    kept = plane.agreeing(pairs, tolerance_px);
    plane.fit(kept);
  }
  const bool enough =
      kept.size() >= PairMeasurement::kFewestMatches && kLeastShare * kept.size() >= pairs.size();
  return enough ? kept : std::vector<PixelPair>();
}

/// Moves right pixels to the sub-pixel place of what the left ones show, where that can be found.
void refine(const cv::Mat& left, const cv::Mat& right, std::vector<PixelPair>* pairs) {
  for (PixelPair& pair : *pairs) {
    const auto place = PatchAligner(left, pair.left).align(right, pair.right);
    if (place) pair.right = place->pixel;
  }
}

template <typename Value>
std::vector<float> valuesOf(const std::vector<PixelPair>& pairs, const Value& value) {
  std::vector<float> values;
  values.reserve(pairs.size());
  for (const PixelPair& pair : pairs) values.push_back(value(pair));
  return values;
}

double contrastOf(const cv::Mat& image) {
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(image, mean, deviation);
  return deviation[0];
}

bool showTheSame(const cv::Mat& left, const cv::Mat& right) {
  if (left.size() != right.size() || cv::norm(left, right, cv::NORM_INF) > 0.0) return false;
  double low = 0.0;
  double high = 0.0;
  cv::minMaxLoc(left, &low, &high);
  return high > low;
}

}  // namespace

PairMeasurement measurePair(const cv::Mat& left, const cv::Mat& right) {
  constexpr float kBandShare = 1.0F / 6.0F;
  constexpr float kLeastBandPx = 32.0F;
  constexpr float kBehindInfinityPx = -1.0F;
  PairMeasurement measurement;
  for (const cv::Mat* image : {&left, &right}) {
    if (image->empty() || image->type() != CV_8UC1) return measurement;
  }
  const Features left_features = detect(left);
  const Features right_features = detect(right);
  measurement.corners_left = static_cast<int>(left_features.size());
  measurement.corners_right = static_cast<int>(right_features.size());
  measurement.contrast_left = contrastOf(left);
  measurement.contrast_right = contrastOf(right);
  measurement.identical = showTheSame(left, right);

  const float band_px = std::max(kLeastBandPx, kBandShare * static_cast<float>(left.rows));
  std::vector<PixelPair> pairs =
      consistentPairs(matchInBand(left_features, right_features, band_px), band_px, left.size());
  if (pairs.empty()) return measurement;
  refine(left, right, &pairs);
  const auto row = [](const PixelPair& pair) { return pair.rowDifference(); };
  const auto amount = [](const PixelPair& pair) { return std::abs(pair.rowDifference()); };
  const auto disparity = [](const PixelPair& pair) { return pair.disparity(); };
  measurement.matches = static_cast<int>(pairs.size());
  measurement.row_offset_px = median(valuesOf(pairs, row));
  measurement.row_distance_px = median(valuesOf(pairs, amount));
  measurement.disparity_px = median(valuesOf(pairs, disparity));
  const auto behind = std::count_if(pairs.begin(), pairs.end(), [&](const PixelPair& pair) {
    return pair.disparity() < kBehindInfinityPx;
  });
  measurement.behind_infinity_share =
      static_cast<double>(behind) / static_cast<double>(pairs.size());
  return measurement;
}

}  // namespace point_line_odometry
