#include "common/area_reduction.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/processor_clones.h"

namespace point_line_odometry {
namespace {

/// The pixels that each pixel of a smaller row (or column) covers, with their shares.
struct Coverage {
  int num_taps = 0;            ///< most pixels that one covers
  std::vector<int> first;      ///< for each pixel
  std::vector<float> weights;  ///< num_taps of each pixel, together 1

  Coverage(int length, int reduced) {
    const double ratio = static_cast<double>(length) / reduced;
    num_taps = std::min(static_cast<int>(std::ceil(ratio)) + 1, length);
    weights.resize(static_cast<std::size_t>(reduced) * static_cast<std::size_t>(num_taps));
    for (int i = 0; i < reduced; ++i) {
      const double begin = ratio * i;
      const double end = std::min(ratio * (i + 1), static_cast<double>(length));
      // No pixel beyond the last is read, be its weight zero.
      const int at = std::min(static_cast<int>(begin), length - num_taps);
      for (int tap = 0; tap < num_taps; ++tap) {
        const double covered =
            std::min(end, at + tap + 1.0) - std::max(begin, static_cast<double>(at + tap));
        weights[static_cast<std::size_t>(i * num_taps + tap)] =
            static_cast<float>(std::max(covered, 0.0) / (end - begin));
      }
      first.push_back(at);
    }
  }

  const float* of(int i) const {
    return weights.data() + static_cast<std::ptrdiff_t>(i) * num_taps;
  }
};

POINT_LINE_ODOMETRY_CLONES("avx2")
void setWeighted(const std::uint8_t* __restrict row, float weight, int width,
                 float* __restrict sums) {
  for (int x = 0; x < width; ++x) sums[x] = weight * static_cast<float>(row[x]);
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void addWeighted(const std::uint8_t* __restrict row, float weight, int width,
                 float* __restrict sums) {
  for (int x = 0; x < width; ++x) sums[x] += weight * static_cast<float>(row[x]);
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void halveRow(const std::uint8_t* __restrict above, const std::uint8_t* __restrict below, int width,
              std::uint8_t* __restrict half) {
  for (int x = 0; x < width; ++x) {
    const int sum = above[2 * x] + above[2 * x + 1] + below[2 * x] + below[2 * x + 1];
    half[x] = static_cast<std::uint8_t>((sum + 2) / 4);
  }
}

/// \tparam kTaps known to the compiler, which unrolls the sum. 0: coverage.num_taps.
template <int kTaps>
void reduceRow(const float* row, const Coverage& coverage, std::uint8_t* reduced) {
  const int taps = kTaps > 0 ? kTaps : coverage.num_taps;
  const float* weights = coverage.weights.data();
  for (const int first : coverage.first) {
    float sum = 0.5F;  // rounds
    for (int k = 0; k < taps; ++k) sum += weights[k] * row[first + k];
    *reduced++ = static_cast<std::uint8_t>(sum);
    weights += taps;
  }
}

}  // namespace

cv::Mat areaReduced(const cv::Mat& image, const cv::Size& size) {
  if (size.width < 1 || size.height < 1 || size.width > image.cols || size.height > image.rows) {
    throw std::invalid_argument("An image of " + std::to_string(image.cols) + " x " +
                                std::to_string(image.rows) + " px cannot be reduced to " +
                                std::to_string(size.width) + " x " + std::to_string(size.height));
  }
  const Coverage columns(image.cols, size.width);
  const Coverage rows(image.rows, size.height);
  cv::Mat reduced(size, CV_8UC1);
  std::vector<float> sums(static_cast<std::size_t>(image.cols));
  for (int y = 0; y < size.height; ++y) {
    for (int k = 0; k < rows.num_taps; ++k) {
      const float weight = rows.of(y)[k];
      const auto* row = image.ptr<std::uint8_t>(rows.first[static_cast<std::size_t>(y)] + k);
      if (k == 0) {
        setWeighted(row, weight, image.cols, sums.data());
      } else if (weight != 0.0F) {
        addWeighted(row, weight, image.cols, sums.data());
      }
    }
    auto* out = reduced.ptr<std::uint8_t>(y);
    if (columns.num_taps == 3) {
      reduceRow<3>(sums.data(), columns, out);
    } else {
      reduceRow<0>(sums.data(), columns, out);
    }
  }
  return reduced;
}

void halve(const cv::Mat& image, cv::Mat* half) {
  half->create(image.rows / 2, image.cols / 2, CV_8UC1);
  for (int y = 0; y < half->rows; ++y) {
    halveRow(image.ptr<std::uint8_t>(2 * y), image.ptr<std::uint8_t>(2 * y + 1), half->cols,
             half->ptr<std::uint8_t>(y));
  }
}

}  // namespace point_line_odometry
