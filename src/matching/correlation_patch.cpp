#include "matching/correlation_patch.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/core/hal/intrin.hpp>

#include "common/processor_clones.h"

namespace point_line_odometry {
namespace {

constexpr int kCorrelationSide = CorrelationPatch::kSide;
constexpr int kCorrelationHalf = kCorrelationSide / 2;
constexpr int kCorrelationArea = kCorrelationSide * kCorrelationSide;
constexpr int kFour = 4;  // values of a vector

/// Taken off the pixels, which changes no correlation: with 8 bits and a sign, all below fits into
/// 32 bits.
constexpr int kMiddleGrey = 128;
static_assert(std::int64_t{kCorrelationArea} * kCorrelationArea * kMiddleGrey * kMiddleGrey <=
              1 << 30);

/// Pixels around the centres of a search, as 16 bits, which multiply and add fastest.
struct SearchWindow {
  int columns = 0;  ///< centres
  int rows = 0;
  int pitch = 0;
  std::vector<std::int16_t> pixels;

  SearchWindow(const cv::Mat& image, const Eigen::Vector2i& first, const Eigen::Vector2i& last)
      : columns(last.x() - first.x() + 1),
        rows(last.y() - first.y() + 1),
        pitch(columns + kCorrelationSide - 1),
        pixels(static_cast<std::size_t>(pitch) * (rows + kCorrelationSide - 1)) {
    for (int y = 0; y < rows + kCorrelationSide - 1; ++y) {
      const std::uint8_t* row =
          image.ptr<std::uint8_t>(first.y() - kCorrelationHalf + y) + first.x() - kCorrelationHalf;
      std::transform(
          row, row + pitch, pixels.begin() + static_cast<std::ptrdiff_t>(y) * pitch,
          [](std::uint8_t value) { return static_cast<std::int16_t>(value - kMiddleGrey); });
    }
  }
};

/// Sums over the patches centred in a row of a search: of their values, of the squares, and of the
/// products with a patch.
struct RowSums {
  std::vector<std::int32_t> values;
  std::vector<std::int32_t> squares;
  std::vector<std::int32_t> products;
};

POINT_LINE_ODOMETRY_CLONES("avx2")
void sumProducts(const std::int16_t* patch, const std::int16_t* window, int pitch, int columns,
                 std::int32_t* products) {
  for (int x = 0; x < columns; ++x) {
    std::int32_t sum = 0;
    for (int r = 0; r < kCorrelationSide; ++r) {
      for (int c = 0; c < kCorrelationSide; ++c)
        sum += patch[r * kCorrelationSide + c] * window[r * pitch + x + c];
    }
    products[x] = sum;
  }
}

/// Running sums of kCorrelationSide columns, at `size` positions.
void sumColumns(const std::vector<std::int32_t>& columns, std::size_t size, std::int32_t* sums) {
  std::int32_t sum = std::accumulate(columns.begin(), columns.begin() + kCorrelationSide, 0);
  for (std::size_t x = 0; x < size; ++x) {
    sums[x] = sum;
    if (x + 1 < size) sum += columns[x + kCorrelationSide] - columns[x];
  }
}

/// Adds a row of pixels to sums of columns, or takes it away again.
POINT_LINE_ODOMETRY_CLONES("avx2")
void addRow(const std::int16_t* row, int size, int sign, std::int32_t* values,
            std::int32_t* squares) {
  for (int x = 0; x < size; ++x) {
    const std::int32_t value = row[x];
    values[x] += sign * value;
    squares[x] += sign * value * value;
  }
}

/// Square root of n times the sum of squared differences from the mean.
float normOf(std::int32_t sum, std::int32_t squares) {
  return std::sqrt(static_cast<float>(kCorrelationArea * squares - sum * sum));
}

/// Correlations of a patch with those of a row; 0 where they are negative, and for uniform ones.
/// Whole vectors are read and written: size is rounded up to four.
POINT_LINE_ODOMETRY_CLONES("avx2")
void correlateRow(const RowSums& sums, int size, std::int32_t patch_sum, float patch_norm,
                  float* correlations) {
  const std::int32_t* values = sums.values.data();
  const std::int32_t* squares = sums.squares.data();
  const std::int32_t* products = sums.products.data();
  const cv::v_int32x4 area = cv::v_setall_s32(kCorrelationArea);
  const cv::v_int32x4 sum = cv::v_setall_s32(patch_sum);
  const cv::v_float32x4 norm = cv::v_setall_f32(patch_norm);
  const cv::v_float32x4 zero = cv::v_setzero_f32();
  for (int x = 0; x < size; x += kFour) {
    const cv::v_int32x4 value = cv::v_load(values + x);
    const cv::v_int32x4 square = cv::v_load(squares + x);
    const cv::v_int32x4 product = cv::v_load(products + x);
    const cv::v_float32x4 covariance = v_cvt_f32(area * product - sum * value);
    const cv::v_float32x4 window_norm = v_sqrt(v_cvt_f32(area * square - value * value));
    v_store(correlations + x, v_select(covariance > zero, covariance / (norm * window_norm), zero));
  }
}

/// Centres of all patches in an image.
Eigen::AlignedBox2f centres(const cv::Mat& image) {
  return {
      Eigen::Vector2f(kCorrelationHalf, kCorrelationHalf),
      Eigen::Vector2i(image.cols - kCorrelationHalf, image.rows - kCorrelationHalf).cast<float>()};
}

/// Maximum of a parabola through three values at -1, 0, 1, of which the middle one is the largest.
float peakOf(float before, float at, float after) {
  const float curvature = before - 2.0F * at + after;
  return curvature < 0.0F ? std::clamp(0.5F * (before - after) / curvature, -0.5F, 0.5F) : 0.0F;
}

}  // namespace

CorrelationPatch::CorrelationPatch(const cv::Mat& image, const Eigen::Vector2f& pixel) {
  const Eigen::Vector2f centre = pixel.array().round();
  if (!pixel.allFinite() || !centres(image).contains(centre)) return;
  fraction_ = pixel - centre;
  const SearchWindow window(image, centre.cast<int>(), centre.cast<int>());
  std::copy(window.pixels.begin(), window.pixels.end(), values_.begin());
  sum_ = std::accumulate(values_.begin(), values_.end(), 0);
  norm_ = normOf(sum_, std::inner_product(values_.begin(), values_.end(), values_.begin(), 0));
}

std::vector<float> CorrelationPatch::correlations(const cv::Mat& image,
                                                  const Eigen::Vector2i& first,
                                                  const Eigen::Vector2i& last) const {
  const SearchWindow window(image, first, last);
  const auto columns = static_cast<std::size_t>(window.columns);
  const std::size_t padded = columns + kFour;
  RowSums sums{std::vector<std::int32_t>(padded), std::vector<std::int32_t>(padded),
               std::vector<std::int32_t>(padded)};
  std::vector<std::int32_t> column_values(static_cast<std::size_t>(window.pitch));
  std::vector<std::int32_t> column_squares(static_cast<std::size_t>(window.pitch));
  std::vector<float> result(columns * static_cast<std::size_t>(window.rows) + kFour);
  for (int y = 0; y < window.rows; ++y) {
    const std::int16_t* row = window.pixels.data() + static_cast<std::ptrdiff_t>(y) * window.pitch;
    for (int r = y == 0 ? 0 : kCorrelationSide - 1; r < kCorrelationSide; ++r)
      addRow(row + r * window.pitch, window.pitch, 1, column_values.data(), column_squares.data());
    sumColumns(column_values, columns, sums.values.data());
    sumColumns(column_squares, columns, sums.squares.data());
    sumProducts(values_.data(), row, window.pitch, window.columns, sums.products.data());
    correlateRow(sums, window.columns, sum_, norm_,
                 result.data() + static_cast<std::size_t>(y) * columns);
    addRow(row, window.pitch, -1, column_values.data(), column_squares.data());
  }
  result.resize(result.size() - kFour);
  return result;
}

std::optional<Eigen::Vector2f> CorrelationPatch::find(const cv::Mat& image,
                                                      const Eigen::AlignedBox2f& window) const {
  if (!window.min().allFinite() || !window.max().allFinite()) return std::nullopt;
  const Eigen::AlignedBox2f clipped = window.intersection(centres(image));
  if (!(norm_ > 0.0F) || clipped.isEmpty()) return std::nullopt;
  const Eigen::Vector2i first = clipped.min().array().round().cast<int>();
  const Eigen::Vector2i last = clipped.max().array().round().cast<int>();
  const std::vector<float> all = correlations(image, first, last);
  const auto best = std::max_element(all.begin(), all.end());
  if (*best < kMinCorrelation) return std::nullopt;
  const auto columns = static_cast<std::ptrdiff_t>(last.x() - first.x() + 1);
  const std::ptrdiff_t x = (best - all.begin()) % columns;
  const std::ptrdiff_t y = (best - all.begin()) / columns;
  Eigen::Vector2f peak =
      first.cast<float>() + Eigen::Vector2f(static_cast<float>(x), static_cast<float>(y));
  if (x > 0 && x + 1 < columns) peak.x() += peakOf(best[-1], best[0], best[1]);
  if (y > 0 && y < last.y() - first.y()) peak.y() += peakOf(best[-columns], best[0], best[columns]);
  return peak + fraction_;
}

}  // namespace point_line_odometry
