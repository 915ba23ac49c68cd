#include "features/line_descriptor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <opencv2/core/hal/intrin.hpp>

#include "point_line_odometry/types.h"

namespace point_line_odometry {
namespace {

constexpr int kBands = 9;
constexpr int kMaxBandWidth = 7;
constexpr int kMaxRows = kBands * kMaxBandWidth;
constexpr int kMaxSamples = 32;  // along the segment; longer ones are sampled more sparsely
constexpr int kSums =
    4;  // gradient along the line and along its normal, positive and negative parts
constexpr int kPerBand = 2 * kSums;
constexpr int kPairs = 32;

using Gradient = cv::Vec<schar, 2>;  // as in GradientImage::coarse
using RowSums = std::array<std::array<float, kSums>, kMaxRows>;
using BandStatistics = std::array<std::array<float, kPerBand>, kBands>;

struct BandPair {
  int first;
  int second;
};

/// 32 of the 36 pairs of bands: all but the four of neighbouring bands at the ends, which are least
/// distinctive.
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

/// The pixels of a row parallel to a segment, relative to the first, and the rows' first pixels, as
/// offsets in GradientImage::coarse.
class SampleGrid {
 public:
  SampleGrid(const LineSegment& anywhere, const cv::Mat& coarse, int num_rows)
      : origin_(coarse.ptr<Gradient>()), stride_(static_cast<std::int32_t>(coarse.step1() / 2)) {
    // Detectors' segments may end a little outside the image.
    const LineSegment segment{nearImage(anywhere.start, coarse.size()),
                              nearImage(anywhere.end, coarse.size())};
    const Eigen::Vector2f along = segment.direction();
    const Eigen::Vector2f normal(-along.y(), along.x());
    count_ = std::clamp(static_cast<int>(segment.length()), 2, kMaxSamples);
    const Eigen::Vector2f step = (segment.end - segment.start) / static_cast<float>(count_ - 1);
    for (int i = 0; i < count_; ++i) steps_[i] = nearestPixel(step * static_cast<float>(i));
    for (int i = 0; i < count_; ++i) masks_[i / 4] |= std::uint64_t{0xFFFF} << (16 * (i % 4));
    const float middle = 0.5F * static_cast<float>(num_rows - 1);
    for (int row = 0; row < num_rows; ++row)
      begins_[row] = nearestPixel(segment.start + normal * (static_cast<float>(row) - middle));
  }

  int count() const { return count_; }

  /// Gradients (gx, gy) at eight pixels of a row, from the i-th on; 0 behind the last. They are put
  /// together in registers: what is stored in pieces is slow to load as a whole.
  cv::v_int8x16 sample(int row, int i) const {
    const Gradient* begin = origin_ + begins_[row];
    return v_reinterpret_as_s8(cv::v_uint64x2(four(begin, i), four(begin, i + 4)));
  }

 private:
  static constexpr int kMaxOutside = 2;  // of the ends [px]
  static_assert(GradientImage::kCoarseMargin >= kMaxOutside + kMaxRows / 2 + 1,
                "all rows of a segment can be read");

  static Eigen::Vector2f nearImage(const Eigen::Vector2f& p, cv::Size size) {
    const auto clamped = [](float value, int length) {
      return std::clamp(value, static_cast<float>(-kMaxOutside),
                        static_cast<float>(length - 1 + kMaxOutside));
    };
    return {clamped(p.x(), size.width), clamped(p.y(), size.height)};
  }

  std::uint64_t four(const Gradient* begin, int i) const {
    const auto at = [&](int k) {
      std::uint16_t bits = 0;
      std::memcpy(&bits, begin[steps_[i + k]].val, sizeof(bits));
      return static_cast<std::uint64_t>(bits) << (16 * k);
    };
    return (at(0) | at(1) | at(2) | at(3)) & masks_[i / 4];
  }

  std::int32_t nearestPixel(const Eigen::Vector2f& p) const {
    return cvRound(p.y()) * stride_ + cvRound(p.x());
  }

  const Gradient* origin_;
  std::int32_t stride_;
  int count_ = 0;
  std::array<std::int32_t, kMaxSamples> steps_{};
  std::array<std::uint64_t, kMaxSamples / 4> masks_{};
  std::array<std::int32_t, kMaxRows> begins_{};
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
RowSums sumRows(const GradientImage& gradient, const LineSegment& segment, int num_rows) {
  // In fixed point: 8 bits of a gradient, 13 of a direction, and 5 of the number of samples.
  constexpr float kOne = 4096.0F;
  const Eigen::Vector2f direction = segment.direction();
  const auto x = static_cast<std::int16_t>(cvRound(kOne * direction.x()));
  const auto y = static_cast<std::int16_t>(cvRound(kOne * direction.y()));
  const auto minus_y = static_cast<std::int16_t>(-y);
  const cv::v_int16x8 along(x, y, x, y, x, y, x, y);
  const cv::v_int16x8 normal(minus_y, x, minus_y, x, minus_y, x, minus_y, x);
  const SampleGrid grid(segment, gradient.coarse, num_rows);
  const float half_mean = 0.5F / (kOne * static_cast<float>(grid.count()));
  RowSums rows{};
  for (int row = 0; row < num_rows; ++row) {
    ComponentSums sums_along;
    ComponentSums sums_normal;
    for (int i = 0; i < grid.count(); i += 8) {
      cv::v_int16x8 first;
      cv::v_int16x8 second;
      v_expand(grid.sample(row, i), first, second);
      for (const cv::v_int16x8& four : {first, second}) {
        sums_along.add(four, along);
        sums_normal.add(four, normal);
      }
    }
    const std::array<float, 2> parts_normal = sums_normal.parts(half_mean);
    const std::array<float, 2> parts_along = sums_along.parts(half_mean);
    rows[row] = {parts_normal[0], parts_normal[1], parts_along[0], parts_along[1]};
  }
  return rows;
}

/// The rows of pixels beside a segment: their bands, and Gaussian weights in each band and its two
/// neighbours.
struct Bands {
  int width;     ///< rows
  int num_rows;  ///< of all bands
  std::array<std::array<float, kMaxRows>, kBands> weight_of_row{};

  /// \param width_px at most kMaxBandWidth.
  explicit Bands(int width_px) : width(width_px), num_rows(kBands * width_px) {
    const auto band_width = static_cast<float>(width);
    const float centre = 0.5F * static_cast<float>(num_rows - 1);
    for (int band = 0; band < kBands; ++band) {
      const float band_centre = (static_cast<float>(band) + 0.5F) * band_width - 0.5F;
      for (int row = 0; row < num_rows; ++row) {
        const float from_line = (static_cast<float>(row) - centre) / (0.5F * centre);
        const float from_band = (static_cast<float>(row) - band_centre) / band_width;
        weight_of_row[band][row] =
            std::exp(-0.5F * (from_line * from_line + from_band * from_band));
      }
    }
  }
};

/// Weighted mean and standard deviation of the row sums in each band and its two neighbours (Zhang
/// and Koch 2013, eq. 3-5).
BandStatistics summariseBands(const RowSums& rows, const Bands& bands) {
  BandStatistics statistics{};
  for (int band = 0; band < kBands; ++band) {
    const int begin = std::max((band - 1) * bands.width, 0);
    const int end = std::min((band + 2) * bands.width, bands.num_rows);
    std::array<float, kSums> mean{};
    std::array<float, kSums> square{};
    for (int row = begin; row < end; ++row) {
      for (int k = 0; k < kSums; ++k) {
        const float value = bands.weight_of_row[band][row] * rows[row][k];
        mean[k] += value;
        square[k] += value * value;
      }
    }
    const auto count = static_cast<float>(end - begin);
    for (int k = 0; k < kSums; ++k) {
      const float average = mean[k] / count;
      statistics[band][k] = average;
      statistics[band][kSums + k] =
          std::sqrt(std::max(square[k] / count - average * average, 0.0F));
    }
  }
  return statistics;
}

}  // namespace

std::vector<Descriptor> describeLines(const GradientImage& gradient,
                                      const std::vector<LineSegment>& segments, int pixel_size) {
  const std::array<BandPair, kPairs> pairs = bandPairs();
  const Bands bands((kMaxBandWidth + pixel_size - 1) / pixel_size);
  std::vector<Descriptor> descriptors;
  descriptors.reserve(segments.size());
  for (const LineSegment& segment : segments) {
    const BandStatistics statistics =
        summariseBands(sumRows(gradient, segment, bands.num_rows), bands);
    Descriptor descriptor{};
    for (int pair = 0; pair < kPairs; ++pair) {
      for (int k = 0; k < kPerBand; ++k) {
        const int bit = pair * kPerBand + k;
        const bool larger = statistics[pairs[pair].first][k] > statistics[pairs[pair].second][k];
        descriptor[bit / 64] |= static_cast<std::uint64_t>(larger) << (bit % 64);
      }
    }
    descriptors.push_back(descriptor);
  }
  return descriptors;
}

}  // namespace point_line_odometry
