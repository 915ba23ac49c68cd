#include "features/fast_corners.h"

#include <algorithm>
#include <array>
#include <opencv2/core/hal/intrin.hpp>

#include "common/processor_clones.h"

namespace point_line_odometry {
namespace {

constexpr int kBlock = 32;  // pixels of a row that are tested together
using Bytes = cv::v_uint8x16;
constexpr int kLanes = Bytes::nlanes;

/// The seven rows that the circle around a pixel touches.
struct Rows {
  const uchar* up3;
  const uchar* up2;
  const uchar* up1;
  const uchar* here;
  const uchar* down1;
  const uchar* down2;
  const uchar* down3;
};

Rows rowsAround(const cv::Mat& image, int y, int x) {
  const auto row = [&](int dy) { return image.ptr<uchar>(y + dy) + x; };
  return {row(-3), row(-2), row(-1), row(0), row(1), row(2), row(3)};
}

inline uchar least(uchar a, uchar b) { return a < b ? a : b; }
inline uchar most(uchar a, uchar b) { return a > b ? a : b; }
/// a - b, or 0 if it is negative.
inline uchar excess(uchar a, uchar b) { return static_cast<uchar>(most(a, b) - b); }

// Compilers vectorise the loops of the two functions below.

/// The largest score that a pixel of a block may have: of two opposite pixels of the circle one is
/// in any arc of nine.
POINT_LINE_ODOMETRY_CLONES("avx2")
void boundScores(const Rows& rows, int num_blocks, std::uint8_t* bounds) {
  for (int block = 0; block < num_blocks; ++block) {
    const int begin = block * kBlock;
    uchar bound = 0;
    for (int x = begin; x < begin + kBlock; ++x) {
      const uchar centre = rows.here[x];
      const uchar left = rows.here[x - 3];
      const uchar right = rows.here[x + 3];
      const uchar up = rows.up3[x];
      const uchar down = rows.down3[x];
      const uchar bright = least(most(left, right), most(up, down));
      const uchar dark = most(least(left, right), least(up, down));
      bound = most(bound, most(excess(bright, centre), excess(centre, dark)));
    }
    bounds[block] = bound;
  }
}

/// The best of the sixteen arcs of nine pixels of a circle, of which the worst pixel counts. Arcs
/// that begin at k and at k + 1 share eight.
template <typename Worse, typename Better>
inline Bytes bestArc(const std::array<Bytes, 16>& p, const Worse& worse, const Better& better) {
  std::array<Bytes, 8> two;  // from k = 1, 3, ... 15 on
  for (int i = 0; i < 8; ++i) two[i] = worse(p[2 * i + 1], p[(2 * i + 2) & 15]);
  std::array<Bytes, 8> four;
  for (int i = 0; i < 8; ++i) four[i] = worse(two[i], two[(i + 1) & 7]);
  const auto nine = [&](int i) {
    return worse(worse(four[i], four[(i + 2) & 7]), better(p[2 * i], p[(2 * i + 9) & 15]));
  };
  Bytes best = nine(0);
  for (int i = 1; i < 8; ++i) best = better(best, nine(i));
  return best;
}

/// FAST scores of a block, 0 for those not above the threshold: by how much all pixels of an arc of
/// nine are brighter, or all darker, than the centre.
void scoreBlock(const Rows& rows, std::uint8_t threshold, std::uint8_t* scores) {
  const auto least = [](const Bytes& a, const Bytes& b) { return v_min(a, b); };
  const auto most = [](const Bytes& a, const Bytes& b) { return v_max(a, b); };
  const Bytes limit = cv::v_setall_u8(threshold);
  for (int x = 0; x < kBlock; x += kLanes) {
    const auto at = [x](const uchar* row, int dx) { return cv::v_load(row + x + dx); };
    const std::array<Bytes, 16> circle{
        at(rows.down3, 0), at(rows.down3, 1),  at(rows.down2, 2),  at(rows.down1, 3),
        at(rows.here, 3),  at(rows.up1, 3),    at(rows.up2, 2),    at(rows.up3, 1),
        at(rows.up3, 0),   at(rows.up3, -1),   at(rows.up2, -2),   at(rows.up1, -3),
        at(rows.here, -3), at(rows.down1, -3), at(rows.down2, -2), at(rows.down3, -1)};
    const Bytes centre = at(rows.here, 0);
    const Bytes brighter = bestArc(circle, least, most) - centre;  // saturates at 0
    const Bytes darker = centre - bestArc(circle, most, least);
    const Bytes score = v_max(brighter, darker);
    v_store(scores + x, score & (score > limit));
  }
}

/// Calls visit(k) for each bit k that is set, the lowest first.
template <typename Visit>
void forEachBit(unsigned bits, Visit&& visit) {
  for (; bits != 0; bits &= bits - 1) visit(__builtin_ctz(bits));
}

}  // namespace

/// Scores of the pixels of a row from `begin` on, 0 for those not above the threshold of their
/// block.
void FastCorners::scoreRow(const cv::Mat& image, int y, int begin) {
  std::uint8_t* scores = scoresOf(y) + begin;
  const auto num_blocks = static_cast<int>(block_thresholds_.size());
  boundScores(rowsAround(image, y, begin), num_blocks, bounds_.data());
  for (int block = 0; block < num_blocks; ++block) {
    const int x = block * kBlock;
    if (bounds_[block] > block_thresholds_[block]) {
      scoreBlock(rowsAround(image, y, begin + x), block_thresholds_[block], scores + x);
    } else {
      std::fill_n(scores + x, kBlock, std::uint8_t{0});
    }
  }
}

/// Of each block the least threshold of the cells of its pixels and their neighbours: a score that
/// is dropped must not be missed where it is compared with one of a neighbouring cell.
void FastCorners::setBlockThresholds(int cell_size_px) {
  int x = 0;
  for (std::uint8_t& threshold : block_thresholds_) {
    threshold = static_cast<std::uint8_t>(
        thresholds_.least(std::max(x - 1, 0) / cell_size_px, (x + kBlock) / cell_size_px));
    x += kBlock;
  }
}

/// Appends the maxima of a row that exceed the threshold of their cell. \param allowed row of the
/// mask, or null.
void FastCorners::collectMaxima(int y, int begin, int end, int cell_size_px, const uchar* allowed) {
  const std::uint8_t* __restrict above = scoresOf(y - 1);
  const std::uint8_t* __restrict here = scoresOf(y);
  const std::uint8_t* __restrict below = scoresOf(y + 1);
  for (int x = begin; x < end; x += kLanes) {
    const Bytes score = cv::v_load(here + x);
    if (!v_check_any(score > cv::v_setzero_u8())) continue;
    const auto rowMaximum = [x](const std::uint8_t* row) {
      return v_max(cv::v_load(row + x), v_max(cv::v_load(row + x - 1), cv::v_load(row + x + 1)));
    };
    const Bytes in_row = v_max(cv::v_load(here + x - 1), cv::v_load(here + x + 1));
    const Bytes others = v_max(in_row, v_max(rowMaximum(above), rowMaximum(below)));
    const auto is_maximum = static_cast<unsigned>(v_signmask(score > others));
    forEachBit(is_maximum, [&](int k) {
      const int column = (x + k - begin) / cell_size_px;
      if (x + k >= end || here[x + k] <= thresholds_.of(column)) return;
      if (allowed != nullptr && allowed[x + k] == 0) return;
      thresholds_.add(column, here[x + k]);
      corners_.push_back(
          {static_cast<std::int16_t>(x + k), static_cast<std::int16_t>(y), here[x + k]});
    });
  }
}

const std::vector<FastCorner>& FastCorners::detect(const cv::Mat& image, int threshold, int border,
                                                   const CornerCells& cells,
                                                   const cv::Mat& allowed) {
  corners_.clear();
  const int begin = border;
  const int end = image.cols - border;
  const int bottom = image.rows - border;
  if (begin >= end || border >= bottom) return corners_;
  stride_ = static_cast<std::size_t>(image.cols) + kBlock;
  scores_.assign(3 * stride_, 0);
  block_thresholds_.resize(static_cast<std::size_t>((end - begin + kBlock - 1) / kBlock));
  bounds_.resize(block_thresholds_.size());
  // One row behind: the maxima of a row need the next one's scores.
  for (int y = border; y <= bottom; ++y) {
    const int row_in_cell = (y - border) % cells.size_px;
    // Rows at the edge of a cell are compared with those of another.
    if (row_in_cell == 0 || row_in_cell == cells.size_px - 1) {
      std::fill(block_thresholds_.begin(), block_thresholds_.end(),
                static_cast<std::uint8_t>(threshold));
    } else {
      setBlockThresholds(cells.size_px);
    }
    if (y < bottom) {
      scoreRow(image, y, begin);
    } else {
      std::fill_n(scoresOf(y), stride_, std::uint8_t{0});
    }
    if (y > border) {
      collectMaxima(y - 1, begin, end, cells.size_px,
                    allowed.empty() ? nullptr : allowed.ptr<uchar>(y - 1));
    }
    if (row_in_cell == 0) thresholds_.reset(cells, end - begin, threshold);
  }
  return corners_;
}

}  // namespace point_line_odometry
