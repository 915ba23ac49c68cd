#include "features/fast_corners.h"

#include <algorithm>
#include <array>
#include <opencv2/core/hal/intrin.hpp>

#include "common/non_zero_bytes.h"

namespace point_line_odometry {
namespace {

constexpr int kCircle = 16;
constexpr int kLanes = 16;
using Bytes = cv::v_uint8x16;
using Offsets = std::array<std::ptrdiff_t, kCircle>;

/// From a pixel to those on the circle round it, in order.
Offsets circleOffsets(std::ptrdiff_t step) {
  constexpr std::array<std::array<int, 2>, kCircle> kCirclePixels{{{0, 3},
                                                                   {1, 3},
                                                                   {2, 2},
                                                                   {3, 1},
                                                                   {3, 0},
                                                                   {3, -1},
                                                                   {2, -2},
                                                                   {1, -3},
                                                                   {0, -3},
                                                                   {-1, -3},
                                                                   {-2, -2},
                                                                   {-3, -1},
                                                                   {-3, 0},
                                                                   {-3, 1},
                                                                   {-2, 2},
                                                                   {-1, 3}}};
  Offsets offsets{};
  for (int k = 0; k < kCircle; ++k) offsets[k] = kCirclePixels[k][1] * step + kCirclePixels[k][0];
  return offsets;
}

Bytes brighter(const Bytes& a, const Bytes& than) { return v_sub_wrap(v_max(a, than), than); }

/// Least of each nine differences in a row, greatest over the sixteen rows of nine. Those that
/// begin at k and at k + 1 have eight in common.
Bytes bestNineInARow(const std::array<Bytes, kCircle>& d) {
  std::array<Bytes, kCircle / 2> two;  // from k = 1, 3, ... 15 on
  for (int i = 0; i < 8; ++i) two[i] = v_min(d[2 * i + 1], d[(2 * i + 2) & 15]);
  std::array<Bytes, kCircle / 2> four;
  for (int i = 0; i < 8; ++i) four[i] = v_min(two[i], two[(i + 1) & 7]);
  Bytes best = cv::v_setzero_u8();
  for (int i = 0; i < 8; ++i) {
    const Bytes eight = v_min(four[i], four[(i + 2) & 7]);
    best = v_max(best, v_min(eight, v_max(d[2 * i], d[(2 * i + 9) & 15])));
  }
  return best;
}

/// Whether any of sixteen pixels can be a corner: of two opposite pixels of the circle one is among
/// any nine in a row.
bool mayHaveCorner(const uchar* pixel, const Offsets& offsets, const Bytes& centre,
                   const Bytes& threshold) {
  const Bytes p0 = cv::v_load(pixel + offsets[0]);
  const Bytes p4 = cv::v_load(pixel + offsets[4]);
  const Bytes p8 = cv::v_load(pixel + offsets[8]);
  const Bytes p12 = cv::v_load(pixel + offsets[12]);
  const Bytes bright = brighter(v_min(v_max(p0, p8), v_max(p4, p12)), centre);
  const Bytes dark = brighter(centre, v_max(v_min(p0, p8), v_min(p4, p12)));
  return v_check_any(v_max(bright, dark) > threshold);
}

/// Scores of the pixels begin ... end - 1 of a row, 0 for those not above the threshold; up to 15
/// more are written.
void scoreRow(const uchar* row, const Offsets& offsets, int begin, int end, int threshold,
              std::uint8_t* scores) {
  const Bytes limit = cv::v_setall_u8(static_cast<uchar>(threshold));
  for (int x = begin; x < end; x += kLanes) {
    const Bytes centre = cv::v_load(row + x);
    if (!mayHaveCorner(row + x, offsets, centre, limit)) {
      v_store(scores + x, cv::v_setzero_u8());
      continue;
    }
    std::array<Bytes, kCircle> bright;
    std::array<Bytes, kCircle> dark;
    for (int k = 0; k < kCircle; ++k) {
      const Bytes pixel = cv::v_load(row + x + offsets[k]);
      bright[k] = brighter(pixel, centre);
      dark[k] = brighter(centre, pixel);
    }
    const Bytes score = v_max(bestNineInARow(bright), bestNineInARow(dark));
    v_store(scores + x, score & (score > limit));
  }
}

}  // namespace

void FastCorners::collectMaxima(int y, int begin, int end) {
  const std::uint8_t* __restrict above = scoresOf(y - 1);
  const std::uint8_t* __restrict here = scoresOf(y);
  const std::uint8_t* __restrict below = scoresOf(y + 1);
  for (int x = begin; x < end; x += kLanes) {
    const auto rowMaximum = [x](const std::uint8_t* row) {
      return v_max(cv::v_load(row + x), v_max(cv::v_load(row + x - 1), cv::v_load(row + x + 1)));
    };
    const Bytes score = cv::v_load(here + x);
    if (!v_check_any(score > cv::v_setzero_u8())) {
      v_store(maxima_.data() + x, score);
      continue;
    }
    const Bytes beside = v_max(cv::v_load(here + x - 1), cv::v_load(here + x + 1));
    const Bytes others = v_max(beside, v_max(rowMaximum(above), rowMaximum(below)));
    v_store(maxima_.data() + x, score & (score > others));
  }
  forEachNonZero(maxima_.data(), begin, end, [&](int x) {
    corners_.push_back({static_cast<std::int16_t>(x), static_cast<std::int16_t>(y), maxima_[x]});
  });
}

const std::vector<FastCorner>& FastCorners::detect(const cv::Mat& image, int threshold,
                                                   int border) {
  corners_.clear();
  const int begin = border;
  const int end = image.cols - border;
  const int bottom = image.rows - border;
  if (begin >= end || border >= bottom) return corners_;
  stride_ = static_cast<std::size_t>(image.cols);
  scores_.assign(3 * stride_, 0);
  maxima_.assign(stride_, 0);
  const Offsets offsets = circleOffsets(static_cast<std::ptrdiff_t>(image.step1()));
  // One row behind: the maxima of a row need the next one's scores.
  for (int y = border; y <= bottom; ++y) {
    if (y < bottom) {
      scoreRow(image.ptr<uchar>(y), offsets, begin, end, threshold, scoresOf(y));
    } else {
      std::fill_n(scoresOf(y), stride_, std::uint8_t{0});
    }
    if (y > border) collectMaxima(y - 1, begin, end);
  }
  return corners_;
}

}  // namespace point_line_odometry
