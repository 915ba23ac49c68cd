#include <algorithm>
#include <array>
#include <cmath>

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

/// Sums of the gradient in the segment's own axes, for each row of pixels parallel to it. Pixels
/// outside the image count as without gradient.
RowSums sumRows(const GradientImage& gradient, const LineSegment& segment) {
  RowSums rows{};
  const Eigen::Vector2f along = segment.direction();
  const Eigen::Vector2f across(-along.y(), along.x());
  const int samples = std::clamp(static_cast<int>(segment.length()), 2, kMaxSamples);
  const Eigen::Vector2f step = (segment.end - segment.start) / static_cast<float>(samples - 1);
  const auto width = static_cast<unsigned>(gradient.gx.cols);
  const auto height = static_cast<unsigned>(gradient.gx.rows);
  const short* gx = gradient.gx.ptr<short>();
  const short* gy = gradient.gy.ptr<short>();
  // Places in 1/65536 px: stepping needs no conversion from floating point.
  constexpr float kOne = 65536.0F;
  const auto step_x = static_cast<int>(step.x() * kOne);
  const auto step_y = static_cast<int>(step.y() * kOne);
  for (int row = 0; row < kRows; ++row) {
    const Eigen::Vector2f begin =
        segment.start + across * static_cast<float>(row - kRows / 2) + Eigen::Vector2f(0.5F, 0.5F);
    int x_fixed = static_cast<int>(begin.x() * kOne);
    int y_fixed = static_cast<int>(begin.y() * kOne);
    float sum_across = 0.0F;
    float sum_across_size = 0.0F;
    float sum_along = 0.0F;
    float sum_along_size = 0.0F;
    for (int i = 0; i < samples; ++i, x_fixed += step_x, y_fixed += step_y) {
      const int x = x_fixed >> 16;
      const int y = y_fixed >> 16;
      if (static_cast<unsigned>(x) >= width || static_cast<unsigned>(y) >= height) continue;
      const std::size_t pixel = static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x);
      const auto dx = static_cast<float>(gx[pixel]);
      const auto dy = static_cast<float>(gy[pixel]);
      const float g_along = dx * along.x() + dy * along.y();
      const float g_across = dx * across.x() + dy * across.y();
      sum_across += g_across;
      sum_across_size += std::abs(g_across);
      sum_along += g_along;
      sum_along_size += std::abs(g_along);
    }
    const float half_mean = 0.5F / static_cast<float>(samples);
    rows[row] = {
        half_mean * (sum_across_size + sum_across), half_mean * (sum_across_size - sum_across),
        half_mean * (sum_along_size + sum_along), half_mean * (sum_along_size - sum_along)};
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
