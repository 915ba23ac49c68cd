#include "features/edge_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "common/non_zero_bytes.h"
#include "common/processor_clones.h"

namespace point_line_odometry {
namespace {

// The two loops below have no branches and load all operands unconditionally, so that compilers
// vectorise them.

/// Strength in the high byte, direction in the low one; 0 below the threshold. The arc tangent
/// within an octant is approximated by a parabola, to 0.2 of the directions' unit.
POINT_LINE_ODOMETRY_CLONES("avx2")
void encodeRow(const short* __restrict gx, const short* __restrict gy, int width, int threshold,
               std::uint16_t* __restrict out) {
  for (int x = 0; x < width; ++x) {
    const int dx = gx[x];
    const int dy = gy[x];
    const int ax = std::abs(dx);
    const int ay = std::abs(dy);
    const int beyond_diagonal = (ax - ay) >> 31;
    const int excess = (ax - ay) & beyond_diagonal;
    const auto shorter = static_cast<float>(ay + excess);
    const auto longer = static_cast<float>(ax - excess);
    const float ratio = shorter / (longer + 1e-3F);
    const int in_octant = static_cast<int>(ratio * (43.12F - 11.12F * ratio) + 0.5F);
    // a ^ -1 is -1 - a: reflections by masks of the signs.
    const int in_quadrant = (in_octant ^ beyond_diagonal) + (65 & beyond_diagonal);
    const int left = dx >> 31;
    const int in_half = (in_quadrant ^ left) + (129 & left);
    const int up = dy >> 31;
    const int direction = (in_half ^ up) - up;
    const int strength = std::min((ax + ay) >> 2, 255);
    const int is_edge = (threshold - 1 - ax - ay) >> 31;
    out[x] = static_cast<std::uint16_t>(((strength << 8) | (direction & 255)) & is_edge);
  }
}

struct Magnitudes {
  const ushort* above;
  const ushort* here;
  const ushort* below;
};

/// Marks the maxima of the gradient along the edge's normal: those on steep edges if `steep_row`,
/// those on flat edges in the given columns.
POINT_LINE_ODOMETRY_CLONES("avx2")
void markAnchors(const short* __restrict gx, const short* __restrict gy,
                 const Magnitudes& magnitudes, cv::Range columns, int threshold, bool steep_row,
                 const std::uint8_t* __restrict flat_columns, std::uint8_t* __restrict marks) {
  const ushort* __restrict here = magnitudes.here;
  const ushort* __restrict above = magnitudes.above;
  const ushort* __restrict below = magnitudes.below;
  const auto least = static_cast<ushort>(threshold);
  const auto steep_wanted = static_cast<ushort>(steep_row ? 1 : 0);
  for (int x = columns.start; x < columns.end; ++x) {
    const ushort m = here[x];
    const ushort left = here[x - 1];
    const ushort right = here[x + 1];
    const ushort up = above[x];
    const ushort down = below[x];
    const auto ax = static_cast<ushort>(std::abs(gx[x]));
    const auto ay = static_cast<ushort>(std::abs(gy[x]));
    const auto steep = static_cast<ushort>(ax >= ay);
    const auto along_row = static_cast<ushort>((m > left) & (m >= right) & steep & steep_wanted);
    const auto along_column =
        static_cast<ushort>((m > up) & (m >= down) & (steep ^ 1) & flat_columns[x]);
    marks[x] = static_cast<std::uint8_t>((along_row | along_column) & (m >= least));
  }
}

}  // namespace

void EdgeMap::collectAnchors(const GradientImage& gradient, int y) {
  const ushort* magnitude = gradient.magnitude.ptr<ushort>(y);
  const std::int32_t begin = (y + kMargin) * stride_ + kMargin;
  forEachNonZero(is_anchor_.data(), 0, gradient.magnitude.cols, [&](int x) {
    candidates_.push_back({begin + x, magnitude[x]});
  });
}

/// Strong edges first, in steps of a factor of two; within a step in reading order, which visits
/// memory in order, too.
void EdgeMap::sortAnchors() {
  constexpr int kBins = 8;
  const auto binOf = [](const Candidate& candidate) {
    int bin = kBins - 1;
    for (int limit = 32; bin > 0 && candidate.magnitude >= limit; limit *= 2) --bin;
    return bin;
  };
  std::array<int, kBins + 1> begins{};
  for (const Candidate& candidate : candidates_) ++begins[binOf(candidate) + 1];
  for (int bin = 1; bin <= kBins; ++bin) begins[bin] += begins[bin - 1];
  anchors_.resize(candidates_.size());
  for (const Candidate& candidate : candidates_)
    anchors_[begins[binOf(candidate)]++] = candidate.index;
}

/// Anchors there are no edge pixels then.
void EdgeMap::eraseWhereZero(const cv::Mat& allowed) {
  for (int y = 0; y < allowed.rows; ++y) {
    const uchar* row = allowed.ptr<uchar>(y);
    std::uint16_t* pixels = pixels_.data() + (y + kMargin) * stride_ + kMargin;
    for (int x = 0; x < allowed.cols; ++x) pixels[x] = row[x] == 0 ? std::uint16_t{0} : pixels[x];
  }
}

void EdgeMap::compute(const GradientImage& gradient, int threshold, int anchor_interval,
                      const cv::Mat& allowed) {
  const cv::Size size = gradient.magnitude.size();
  stride_ = size.width + 2 * kMargin;
  pixels_.assign(static_cast<std::size_t>(stride_) * (size.height + 2 * kMargin), 0);
  is_anchor_.assign(static_cast<std::size_t>(size.width) + 8, 0);
  flat_columns_.assign(static_cast<std::size_t>(size.width), 0);
  for (int x = 0; x < size.width; x += anchor_interval) flat_columns_[x] = 1;
  candidates_.clear();
  for (int y = 1; y < size.height - 1; ++y) {
    const short* gx = gradient.gx.ptr<short>(y);
    const short* gy = gradient.gy.ptr<short>(y);
    std::uint16_t* out = pixels_.data() + (y + kMargin) * stride_ + kMargin;
    encodeRow(gx + 1, gy + 1, size.width - 2, threshold, out + 1);
    const Magnitudes magnitudes{gradient.magnitude.ptr<ushort>(y - 1),
                                gradient.magnitude.ptr<ushort>(y),
                                gradient.magnitude.ptr<ushort>(y + 1)};
    markAnchors(gx, gy, magnitudes, {1, size.width - 1}, threshold, y % anchor_interval == 0,
                flat_columns_.data(), is_anchor_.data());
    collectAnchors(gradient, y);
  }
  if (!allowed.empty()) eraseWhereZero(allowed);
  sortAnchors();
}

}  // namespace point_line_odometry
