#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core/hal/intrin.hpp>

#include "point_line_odometry/line_detector.h"

namespace point_line_odometry {
namespace {

constexpr int kBands = 9;
constexpr int kBandWidth = 7;
constexpr int kRows = kBands * kBandWidth;
constexpr int kMaxSamples = 32;  // along the segment; longer ones are sampled more sparsely
constexpr int kSums = 4;  // gradient along the line and across it, positive and negative parts
constexpr int kPerBand = 2 * kSums;
constexpr int kPairs = 32;

using Gradient = cv::Vec<schar, 2>;  // as in GradientImage::coarse
using RowSums = std::array<std::array<float, kSums>, kRows>;
using BandStatistics = std::array<std::array<float, kPerBand>, kBands>;

struct BandPair {
  int first;
  int second;
};

/// 32 of the 36 pairs of bands: all but the four of neighbours at the ends, which say least.
std::array<BandPair, kPairs> bandPairs() {
  std::array<BandPair, kPairs> pairs{};
  int count = 0;
  for (int a = 0; a < kBands; ++a) {
    for (int b = a + 1; b < kBands; ++b) {
      const bool at_the_ends = b == a + 1 && (a < 2 || a > kBands - 4);
      if (!at_the_ends) pairs[count++] = {a, b};
    }
  }
  return pairs;
}

/// The pixels of a row parallel to a segment, relative to the first, and the rows' first pixels.
class SampleGrid {
 public:
  SampleGrid(const LineSegment& segment, cv::Size size) : size_(size) {
    const Eigen::Vector2f along = segment.direction();
    const Eigen::Vector2f across(-along.y(), along.x());
    count_ = std::clamp(static_cast<int>(segment.length()), 2, kMaxSamples);
    const Eigen::Vector2f step = (segment.end - segment.start) / static_cast<float>(count_ - 1);
    for (int i = 0; i < count_; ++i) {
      steps_[i] = nearestPixel(step * static_cast<float>(i));
      offsets_[i] = steps_[i].y * size.width + steps_[i].x;
    }
    for (int row = 0; row < kRows; ++row)
      begins_[row] = nearestPixel(segment.start + across * static_cast<float>(row - kRows / 2));
    inside_ = true;
    for (const int row : {0, kRows - 1}) {
      inside_ = inside_ && contains(begins_[row]) &&
                contains(begins_[row] + steps_[static_cast<std::size_t>(count_ - 1)]);
    }
  }

  int count() const { return count_; }

  /// Gradients (gx, gy) at the pixels of a row; 0 outside the image.
  void sample(const cv::Mat& coarse, int row, std::array<Gradient, kMaxSamples>* gradients) const {
    const auto begin = static_cast<std::ptrdiff_t>(begins_[row].y) * size_.width + begins_[row].x;
    const Gradient* origin = coarse.ptr<Gradient>() + begin;
    if (inside_) {
      for (int i = 0; i < count_; ++i) (*gradients)[i] = origin[offsets_[i]];
      return;
    }
    for (int i = 0; i < count_; ++i) {
      (*gradients)[i] = contains(begins_[row] + steps_[i]) ? origin[offsets_[i]] : Gradient(0, 0);
    }
  }

 private:
  static cv::Point nearestPixel(const Eigen::Vector2f& p) {
    return {cvRound(p.x()), cvRound(p.y())};
  }
  bool contains(const cv::Point& p) const {
    return p.x >= 0 && p.y >= 0 && p.x < size_.width && p.y < size_.height;
  }

  cv::Size size_;
  int count_ = 0;
  bool inside_ = false;
  std::array<cv::Point, kMaxSamples> steps_;
  std::array<std::int32_t, kMaxSamples> offsets_{};
  std::array<cv::Point, kRows> begins_;
};

/// Sum of the components of gradients along one direction, and sum of their sizes.
struct ComponentSums {
  cv::v_int32x4 sum = cv::v_setzero_s32();
  cv::v_uint32x4 size = cv::v_setzero_u32();

  void add(const cv::v_int16x8& gradients, const cv::v_int16x8& direction) {
    const cv::v_int32x4 component = v_dotprod(gradients, direction);
    sum = sum + component;
    size = size + v_abs(component);
  }

  /// Mean of the positive components, and of the sizes of the negative ones.
  std::array<float, 2> parts(float half_mean) const {
    const int total = v_reduce_sum(sum);
    const int total_size = static_cast<int>(v_reduce_sum(size));
    return {half_mean * static_cast<float>(total_size + total),
            half_mean * static_cast<float>(total_size - total)};
  }
};

/// Sums of the gradient in the segment's own axes, for each row of pixels parallel to it.
RowSums sumRows(const GradientImage& gradient, const LineSegment& segment) {
  // In fixed point: 8 bits of a gradient, 13 of a direction, and 5 of the number of samples.
  constexpr float kOne = 4096.0F;
  const Eigen::Vector2f direction = segment.direction();
  const auto x = static_cast<std::int16_t>(cvRound(kOne * direction.x()));
  const auto y = static_cast<std::int16_t>(cvRound(kOne * direction.y()));
  const auto minus_y = static_cast<std::int16_t>(-y);
  const cv::v_int16x8 along(x, y, x, y, x, y, x, y);
  const cv::v_int16x8 across(minus_y, x, minus_y, x, minus_y, x, minus_y, x);
  const SampleGrid grid(segment, gradient.gx.size());
  const float half_mean = 0.5F / (kOne * static_cast<float>(grid.count()));
  std::array<Gradient, kMaxSamples> samples{};  // beyond the grid's: zeros
  RowSums rows{};
  for (int row = 0; row < kRows; ++row) {
    grid.sample(gradient.coarse, row, &samples);
    ComponentSums sums_along;
    ComponentSums sums_across;
    for (int i = 0; i < kMaxSamples; i += 8) {
      cv::v_int16x8 first;
      cv::v_int16x8 second;
      v_expand(cv::v_load(samples[i].val), first, second);
      for (const cv::v_int16x8& four : {first, second}) {
        sums_along.add(four, along);
        sums_across.add(four, across);
      }
    }
    const std::array<float, 2> parts_across = sums_across.parts(half_mean);
    const std::array<float, 2> parts_along = sums_along.parts(half_mean);
    rows[row] = {parts_across[0], parts_across[1], parts_along[0], parts_along[1]};
  }
  return rows;
}

/// Gaussian weights of the rows in each band and its two neighbours.
struct BandWeights {
  std::array<std::array<float, kRows>, kBands> of_row{};

  BandWeights() {
    constexpr float kCentre = 0.5F * (kRows - 1);
    for (int band = 0; band < kBands; ++band) {
      const float band_centre = (static_cast<float>(band) + 0.5F) * kBandWidth - 0.5F;
      for (int row = 0; row < kRows; ++row) {
        const float from_line = (static_cast<float>(row) - kCentre) / (0.5F * kCentre);
        const float from_band = (static_cast<float>(row) - band_centre) / kBandWidth;
        of_row[band][row] = std::exp(-0.5F * (from_line * from_line + from_band * from_band));
      }
    }
  }
};

/// Weighted mean and standard deviation of the row sums in each band and its two neighbours (Zhang
/// and Koch 2013, eq. 3-5).
BandStatistics summariseBands(const RowSums& rows, const BandWeights& weights) {
  BandStatistics bands{};
  for (int band = 0; band < kBands; ++band) {
    const int begin = std::max((band - 1) * kBandWidth, 0);
    const int end = std::min((band + 2) * kBandWidth, kRows);
    std::array<float, kSums> mean{};
    std::array<float, kSums> square{};
    for (int row = begin; row < end; ++row) {
      for (int k = 0; k < kSums; ++k) {
        const float value = weights.of_row[band][row] * rows[row][k];
        mean[k] += value;
        square[k] += value * value;
      }
    }
    const auto count = static_cast<float>(end - begin);
    for (int k = 0; k < kSums; ++k) {
      const float average = mean[k] / count;
      bands[band][k] = average;
      bands[band][kSums + k] = std::sqrt(std::max(square[k] / count - average * average, 0.0F));
    }
  }
  return bands;
}

}  // namespace

std::vector<Descriptor> describeLines(const GradientImage& gradient,
                                      const std::vector<LineSegment>& segments) {
  const std::array<BandPair, kPairs> pairs = bandPairs();
  const BandWeights weights;
  std::vector<Descriptor> descriptors;
  descriptors.reserve(segments.size());
  for (const LineSegment& segment : segments) {
    const BandStatistics bands = summariseBands(sumRows(gradient, segment), weights);
    Descriptor descriptor{};
    for (int pair = 0; pair < kPairs; ++pair) {
      for (int k = 0; k < kPerBand; ++k) {
        const int bit = pair * kPerBand + k;
        const bool larger = bands[pairs[pair].first][k] > bands[pairs[pair].second][k];
        descriptor[bit / 64] |= static_cast<std::uint64_t>(larger) << (bit % 64);
      }
    }
    descriptors.push_back(descriptor);
  }
  return descriptors;
}

}  // namespace point_line_odometry
