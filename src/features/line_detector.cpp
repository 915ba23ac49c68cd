#include "features/line_detector.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "features/a_contrario.h"
#include "features/edge_chains.h"
#include "features/edge_map.h"
#include "features/line_fit.h"
#include "features/longest_segments.h"

namespace point_line_odometry {
namespace {

constexpr float kSobelScale = 8.0F;             // Sobel units per grey level per pixel
constexpr float kCosTolerance2 = 0.853553391F;  // cos^2(22.5 deg): LSD's angle tolerance
constexpr int kSeedPixels = 8;                  // of the first fit of a segment
constexpr int kSeedStep = 2;                    // pixels to the next seed where one is not straight
constexpr int kMaxOutliersInRow = 2;            // then the segment ends
constexpr double kMaxNextToStronger = 0.3;      // share of a segment's pixels

/// Sub-pixel position of the gradient's ridge at a pixel, by a parabola along the edge's normal.
Eigen::Vector2f subpixel(const GradientImage& gradient, int x, int y) {
  const auto i = static_cast<std::ptrdiff_t>(y) * gradient.gx.cols + x;
  const ushort* magnitude = gradient.magnitude.ptr<ushort>() + i;
  const bool across_x =
      std::abs(gradient.gx.ptr<short>()[i]) >= std::abs(gradient.gy.ptr<short>()[i]);
  const int step = across_x ? 1 : gradient.gx.cols;
  const float before = magnitude[-step];
  const float after = magnitude[step];
  const float curvature = before - 2.0F * magnitude[0] + after;
  const float offset =
      curvature < 0.0F ? std::clamp(0.5F * (before - after) / curvature, -0.5F, 0.5F) : 0.0F;
  const Eigen::Vector2f pixel(static_cast<float>(x), static_cast<float>(y));
  return across_x ? Eigen::Vector2f(pixel.x() + offset, pixel.y())
                  : Eigen::Vector2f(pixel.x(), pixel.y() + offset);
}

/// The gradient along a segment's normal, which points to its brighter side.
class NormalGradient {
 public:
  NormalGradient(const GradientImage& gradient, const LineSegment& segment)
      : gx_(gradient.gx.ptr<short>()),
        gy_(gradient.gy.ptr<short>()),
        width_(gradient.gx.cols),
        height_(gradient.gx.rows),
        along_(segment.direction()) {}

  /// At the nearest pixel of p + distance * normal; 0 outside the image.
  float at(const Eigen::Vector2f& p, float distance) const {
    const int i = index(p.x() - distance * along_.y(), p.y() + distance * along_.x());
    return i < 0 ? 0.0F : gy_[i] * along_.x() - gx_[i] * along_.y();
  }

  /// Whether the gradient at the nearest pixel is within LSD's angle tolerance of the normal.
  bool alignedAt(const Eigen::Vector2f& p) const {
    const int i = index(p.x(), p.y());
    if (i < 0) return false;
    const float gx = gx_[i];
    const float gy = gy_[i];
    const float normal = gy * along_.x() - gx * along_.y();
    return normal > 0.0F && normal * normal >= kCosTolerance2 * (gx * gx + gy * gy);
  }

 private:
  int index(float x, float y) const {
    // NOLINTNEXTLINE(bugprone-incorrect-roundings): lround takes longer, and pixels are positive
    const int column = static_cast<int>(x + 0.5F);
    const int row = static_cast<int>(y + 0.5F);  // NOLINT(bugprone-incorrect-roundings): likewise
    const bool inside = x >= -0.5F && y >= -0.5F && column < width_ && row < height_;
    return inside ? row * width_ + column : -1;
  }

  const short* gx_;
  const short* gy_;
  int width_;
  int height_;
  Eigen::Vector2f along_;
};

/// How many of the first n pixels along a segment, one per pixel of length, have a gradient along
/// its normal.
int countAligned(const GradientImage& gradient, const LineSegment& segment, int n) {
  const NormalGradient normal_gradient(gradient, segment);
  const Eigen::Vector2f along = segment.direction();
  int aligned = 0;
  for (int k = 0; k < n; ++k)
    aligned += normal_gradient.alignedAt(segment.start + along * static_cast<float>(k)) ? 1 : 0;
  return aligned;
}

/// Whether the segment lies on the strongest edge of its polarity within 3 px, at all but 30 % of
/// its pixels. One next to a stronger edge is neither repeatable nor accurate. Samples every other
/// pixel.
bool onStrongestEdge(const GradientImage& gradient, const LineSegment& segment, int n) {
  const NormalGradient normal_gradient(gradient, segment);
  const Eigen::Vector2f along = segment.direction();
  int samples = 0;
  int next_to_stronger = 0;
  for (int k = 0; k < n; k += 2) {
    const Eigen::Vector2f p = segment.start + along * static_cast<float>(k);
    const float own = std::max(
        {normal_gradient.at(p, -1.0F), normal_gradient.at(p, 0.0F), normal_gradient.at(p, 1.0F)});
    const float other = std::max({normal_gradient.at(p, -3.0F), normal_gradient.at(p, -2.0F),
                                  normal_gradient.at(p, 2.0F), normal_gradient.at(p, 3.0F)});
    ++samples;
    next_to_stronger += other > own ? 1 : 0;
  }
  return next_to_stronger <= kMaxNextToStronger * samples;
}

/// A straight piece of a chain: its line, and its pixels [begin, end).
struct StraightPiece {
  LineSegment segment;
  std::size_t begin = 0;
  std::size_t end = 0;
};

/// The next straight piece from `begin` on: a seed is fitted, and grown while pixels lie on it.
/// Empty at the chain's end.
StraightPiece nextStraightPiece(const std::vector<Eigen::Vector2f>& pixels, std::size_t begin,
                                double max_deviation) {
  for (; begin + kSeedPixels <= pixels.size(); begin += kSeedStep) {
    LineFit fit;
    for (std::size_t i = begin; i < begin + kSeedPixels; ++i) fit.add(pixels[i]);
    fit.solve();
    if (fit.normalVariance() > 0.25 * max_deviation * max_deviation) continue;
    std::size_t last = begin + kSeedPixels - 1;
    int next_solve = 2 * kSeedPixels;
    for (std::size_t i = last + 1; i < pixels.size() && i - last <= kMaxOutliersInRow; ++i) {
      if (fit.distance(pixels[i]) > max_deviation) continue;
      fit.add(pixels[i]);
      last = i;
      if (fit.count() >= next_solve) {
        fit.solve();
        next_solve += next_solve / 4;
      }
    }
    fit.solve();
    return {{fit.project(pixels[begin]), fit.project(pixels[last])}, begin, last + 1};
  }
  return {{}, pixels.size(), pixels.size()};
}

}  // namespace

/// Scratch memory, reused for each image.
struct LineDetector::Scratch {
  AContrarioTable table;
  EdgeMap map;
  EdgeChains chains;
  std::vector<Eigen::Vector2f> pixels;  // of a chain's pixels, sub-pixel
};

LineDetector::LineDetector(const LineParameters& parameters, int pixel_size)
    : parameters_(parameters), pixel_size_(pixel_size), scratch_(std::make_unique<Scratch>()) {}
LineDetector::LineDetector(LineDetector&&) noexcept = default;
LineDetector& LineDetector::operator=(LineDetector&&) noexcept = default;
LineDetector::~LineDetector() = default;

std::vector<LineSegment> LineDetector::detect(const GradientImage& gradient,
                                              const FeatureMask& mask) {
  std::vector<LineSegment> segments;
  const cv::Size size = gradient.gx.size();
  if (size.width < 3 || size.height < 3) return segments;
  const cv::Size image_size = size * pixel_size_;
  if (scratch_->table.imageSize() != image_size) scratch_->table = AContrarioTable(image_size);
  EdgeMap& map = scratch_->map;
  const int threshold =
      std::max(EdgeMap::kMinThreshold,
               static_cast<int>(std::lround(parameters_.min_gradient * kSobelScale)));
  const int anchor_interval = std::clamp(static_cast<int>(0.4 * parameters_.min_length_px), 1, 8);
  map.compute(gradient, threshold, anchor_interval, mask.edges());
  for (const std::int32_t anchor : map.anchors()) {
    if (!map[anchor]) continue;
    const std::vector<std::int32_t>& chain = scratch_->chains.follow(anchor, &map);
    // The pixels of a diagonal edge are sqrt(2) apart.
    if (static_cast<double>(chain.size()) < 0.7 * parameters_.min_length_px) continue;
    scratch_->pixels.clear();
    for (const std::int32_t i : chain)
      scratch_->pixels.push_back(subpixel(gradient, map.column(i), map.row(i)));
    addSegments(gradient, &segments);
  }
  mask.cut(parameters_.min_length_px, &segments);
  keepLongest(parameters_.max_count, &segments);
  return segments;
}

/// Appends the straight, meaningful pieces of the chain in the scratch memory.
void LineDetector::addSegments(const GradientImage& gradient,
                               std::vector<LineSegment>* segments) const {
  const std::vector<Eigen::Vector2f>& pixels = scratch_->pixels;
  for (std::size_t begin = 0; begin < pixels.size();) {
    const StraightPiece piece = nextStraightPiece(pixels, begin, parameters_.max_deviation_px);
    begin = piece.end;
    if (piece.segment.length() < parameters_.min_length_px) continue;
    const int n = static_cast<int>(piece.segment.length()) + 1;
    const int aligned = countAligned(gradient, piece.segment, n);
    if (scratch_->table.meaningful(pixel_size_ * n, pixel_size_ * aligned) &&
        onStrongestEdge(gradient, piece.segment, n)) {
      segments->push_back(piece.segment);
    }
  }
}

}  // namespace point_line_odometry
