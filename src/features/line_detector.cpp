#include "point_line_odometry/line_detector.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "features/line_fit.h"

namespace point_line_odometry {
namespace {

constexpr float kSobelScale = 8.0F;                // Sobel units per grey level per pixel
constexpr float kCosTolerance2 = 0.853553391F;     // cos^2(22.5 deg): LSD's angle tolerance
constexpr double kAlignedProbability = 1.0 / 8.0;  // that a random gradient is within it
constexpr int kMaxGap = 7;            // pixels that a chain may jump, e.g. at a crossing
constexpr int kSeedPixels = 8;        // of the first fit of a segment, and of a chain that may jump
constexpr int kMaxOutliersInRow = 4;  // then the segment ends
constexpr int kTableSize = 257;       // segment lengths with a limit of their own

/// Mean gradient of a chain; pixels are compared with it.
struct MeanGradient {
  float x = 0.0F;
  float y = 0.0F;

  void add(float gx, float gy) {
    x += gx;
    y += gy;
  }
  bool agrees(float gx, float gy) const {
    const float dot = gx * x + gy * y;
    return dot > 0.0F && dot * dot >= kCosTolerance2 * (gx * gx + gy * gy) * (x * x + y * y);
  }
  bool steep() const { return std::abs(x) >= std::abs(y); }
};

/// The gradient by pixel index (row * width + column), and the walk along its ridges.
class RidgeWalker {
 public:
  RidgeWalker(const GradientImage& gradient, int threshold, std::uint8_t* visited)
      : gx_(gradient.gx.ptr<short>()),
        gy_(gradient.gy.ptr<short>()),
        magnitude_(gradient.magnitude.ptr<ushort>()),
        visited_(visited),
        width_(gradient.gx.cols),
        height_(gradient.gx.rows),
        threshold_(threshold) {
    std::fill_n(visited_, gradient.gx.total(), std::uint8_t{0});
    for (int x = 0; x < width_; ++x) visited_[x] = visited_[(height_ - 1) * width_ + x] = kBorder;
    for (int y = 0; y < height_; ++y)
      visited_[y * width_] = visited_[y * width_ + width_ - 1] = kBorder;
  }

  static constexpr std::uint8_t kVisited = 1;
  static constexpr std::uint8_t kBeside = 2;
  static constexpr std::uint8_t kBorder = 3;

  bool visited(int i) const { return visited_[i] != 0; }
  int column(int i) const { return i % width_; }
  int row(int i) const { return i / width_; }
  bool inside(int x, int y) const { return x >= 1 && y >= 1 && x < width_ - 1 && y < height_ - 1; }

  /// Takes a pixel into the chain. Its neighbours across the edge belong to the same edge and start
  /// no chain of their own.
  void visit(int i, MeanGradient* mean) {
    visited_[i] = kVisited;
    mean->add(gx_[i], gy_[i]);
    const int step = mean->steep() ? 1 : width_;
    for (const int beside : {i - step, i + step}) {
      if (visited_[beside] == 0 && mean->agrees(gx_[beside], gy_[beside]))
        visited_[beside] = kBeside;
    }
  }

  /// Appends the pixels of the ridge that continues the chain; `sign` +1 walks with the brighter
  /// side on the right hand.
  void walk(int sign, MeanGradient* mean, std::vector<std::int32_t>* chain) {
    for (int next = chain->back();;) {
      int following = neighbour(next, sign, *mean);
      if (following < 0 && chain->size() >= kSeedPixels) following = beyondGap(next, sign, *mean);
      if (following < 0) return;
      visit(following, mean);
      chain->push_back(following);
      next = following;
    }
  }

  /// Place of the ridge through a pixel, by a parabola across the edge.
  Eigen::Vector2f subpixel(int i) const {
    const bool across_x = std::abs(gx_[i]) >= std::abs(gy_[i]);
    const int step = across_x ? 1 : width_;
    const float before = magnitude_[i - step];
    const float here = magnitude_[i];
    const float after = magnitude_[i + step];
    const float curvature = before - 2.0F * here + after;
    const float offset =
        curvature < 0.0F ? std::clamp(0.5F * (before - after) / curvature, -0.5F, 0.5F) : 0.0F;
    const auto x = static_cast<float>(column(i));
    const auto y = static_cast<float>(row(i));
    return across_x ? Eigen::Vector2f(x + offset, y) : Eigen::Vector2f(x, y + offset);
  }

  /// How many of the pixels along a segment, one per pixel of length, have a gradient across it.
  int countAligned(const LineSegment& segment, int n) const {
    const Eigen::Vector2f direction = segment.direction();
    const MeanGradient normal{-direction.y(), direction.x()};
    Eigen::Vector2f p = segment.start + Eigen::Vector2f(0.5F, 0.5F);
    int aligned = 0;
    for (int k = 0; k < n; ++k, p += direction) {
      const int x = static_cast<int>(p.x());
      const int y = static_cast<int>(p.y());
      if (!inside(x, y)) continue;
      const int i = y * width_ + x;
      aligned += normal.agrees(gx_[i], gy_[i]) ? 1 : 0;
    }
    return aligned;
  }

 private:
  bool usable(int i, const MeanGradient& mean) const {
    return magnitude_[i] >= threshold_ && visited_[i] == 0 && mean.agrees(gx_[i], gy_[i]);
  }

  /// The strongest usable one of three pixels across the walk, or -1. Pixels of the border are
  /// never usable.
  int strongestAcross(int i, const MeanGradient& mean) const {
    const int step = mean.steep() ? 1 : width_;
    int best = -1;
    int best_magnitude = 0;
    for (const int candidate : {i, i - step, i + step}) {
      if (magnitude_[candidate] <= best_magnitude || !usable(candidate, mean)) continue;
      best = candidate;
      best_magnitude = magnitude_[candidate];
    }
    return best;
  }

  /// The next pixel of the ridge: one step along its main axis. The edge's direction is (mean.y,
  /// -mean.x).
  int neighbour(int i, int sign, const MeanGradient& mean) const {
    const int step = mean.steep() ? (mean.x > 0.0F ? -width_ : width_) : (mean.y > 0.0F ? 1 : -1);
    const int next = i + sign * step;
    // On the border its own neighbours may lie outside the image.
    return isBorder(next) ? -1 : strongestAcross(next, mean);
  }

  bool isBorder(int i) const { return visited_[i] == kBorder; }

  /// The pixel straight ahead where the ridge goes on for at least two pixels, or -1.
  int beyondGap(int i, int sign, const MeanGradient& mean) const {
    const float scale = static_cast<float>(sign) / std::max(std::abs(mean.x), std::abs(mean.y));
    for (int gap = 2; gap <= kMaxGap; ++gap) {
      const int x = column(i) + cvRound(mean.y * scale * static_cast<float>(gap));
      const int y = row(i) - cvRound(mean.x * scale * static_cast<float>(gap));
      if (!inside(x, y)) return -1;
      const int landing = strongestAcross(y * width_ + x, mean);
      if (landing >= 0 && neighbour(landing, sign, mean) >= 0) return landing;
    }
    return -1;
  }

  const short* gx_;
  const short* gy_;
  const ushort* magnitude_;
  std::uint8_t* visited_;
  int width_;
  int height_;
  int threshold_;
};

/// A straight piece of a chain: its line, and its pixels [begin, end).
struct StraightPiece {
  LineSegment segment;
  std::size_t begin = 0;
  std::size_t end = 0;
};

/// The next straight piece from `begin` on: a seed is fitted, and grown while pixels lie on it.
/// Empty at the chain's end.
StraightPiece nextStraightPiece(const std::vector<Eigen::Vector2f>& places, std::size_t begin,
                                double max_deviation) {
  for (; begin + kSeedPixels <= places.size(); ++begin) {
    LineFit fit;
    for (std::size_t i = begin; i < begin + kSeedPixels; ++i) fit.add(places[i]);
    fit.solve();
    if (fit.varianceAcross() > 0.25 * max_deviation * max_deviation) continue;
    std::size_t last = begin + kSeedPixels - 1;
    int next_solve = 2 * kSeedPixels;
    for (std::size_t i = last + 1; i < places.size() && i - last <= kMaxOutliersInRow; ++i) {
      if (fit.distance(places[i]) > max_deviation) continue;
      fit.add(places[i]);
      last = i;
      if (fit.count() >= next_solve) {
        fit.solve();
        next_solve += next_solve / 4;
      }
    }
    fit.solve();
    return {{fit.project(places[begin]), fit.project(places[last])}, begin, last + 1};
  }
  return {{}, places.size(), places.size()};
}

/// Least k with sum_{i >= k} C(n, i) p^i (1 - p)^(n - i) * 10^log10_tests <= 1; n + 1 if there is
/// none.
int fewestAlignedPixels(int n, double log10_tests) {
  const double log_p = std::log10(kAlignedProbability);
  const double log_q = std::log10(1.0 - kAlignedProbability);
  double log_binomial = 0.0;
  double false_alarms = 0.0;
  for (int k = n; k > 0; --k) {
    false_alarms += std::pow(10.0, log_binomial + k * log_p + (n - k) * log_q + log10_tests);
    if (false_alarms > 1.0) return k + 1;
    log_binomial += std::log10(static_cast<double>(k)) - std::log10(static_cast<double>(n - k + 1));
  }
  return 1;
}

}  // namespace

GradientImage computeGradient(const cv::Mat& image) {
  GradientImage gradient;
  cv::Mat smooth;
  cv::GaussianBlur(image, smooth, cv::Size(5, 5), 1.0, 1.0,
                   cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
  cv::spatialGradient(smooth, gradient.gx, gradient.gy, 3, cv::BORDER_REPLICATE);
  gradient.magnitude.create(image.size(), CV_16UC1);
  for (int y = 0; y < image.rows; ++y) {
    const short* gx = gradient.gx.ptr<short>(y);
    const short* gy = gradient.gy.ptr<short>(y);
    ushort* magnitude = gradient.magnitude.ptr<ushort>(y);
    for (int x = 0; x < image.cols; ++x) {
      magnitude[x] = static_cast<ushort>(std::abs(gx[x]) + std::abs(gy[x]));
    }
  }
  return gradient;
}

AContrarioTable::AContrarioTable(cv::Size image_size) : image_size_(image_size) {
  const double log10_tests = 2.5 * std::log10(static_cast<double>(image_size.area()));
  for (int n = 0; n < kTableSize; ++n) fewest_.push_back(fewestAlignedPixels(n, log10_tests));
}

bool AContrarioTable::meaningful(int n, int aligned) const {
  if (n < kTableSize) return aligned >= fewest_[n];
  // Beyond the table the share of its last entry is asked for, which is stricter.
  return static_cast<std::int64_t>(aligned) * (kTableSize - 1) >=
         static_cast<std::int64_t>(fewest_.back()) * n;
}

void LineDetector::findAnchors(const GradientImage& gradient, int threshold) {
  constexpr int kBins = 256;
  constexpr int kBinShift = 3;
  const auto binOf = [](int magnitude) {
    return kBins - 1 - std::min(magnitude >> kBinShift, kBins - 1);
  };
  std::array<int, kBins + 1> begins{};
  const int width = gradient.magnitude.cols;
  const ushort* all = gradient.magnitude.ptr<ushort>();
  candidates_.clear();
  for (int y = 1; y < gradient.magnitude.rows - 1; ++y) {
    const ushort* magnitude = gradient.magnitude.ptr<ushort>(y);
    const short* gx = gradient.gx.ptr<short>(y);
    const short* gy = gradient.gy.ptr<short>(y);
    for (int x = 1; x < width - 1; ++x) {
      const int here = magnitude[x];
      if (here < threshold) continue;
      const int step = std::abs(gx[x]) >= std::abs(gy[x]) ? 1 : width;
      if (here <= magnitude[x - step] || here < magnitude[x + step]) continue;
      candidates_.push_back(y * width + x);
      ++begins[binOf(here) + 1];
    }
  }
  for (int bin = 1; bin <= kBins; ++bin) begins[bin] += begins[bin - 1];
  anchors_.resize(candidates_.size());
  for (const std::int32_t i : candidates_) anchors_[begins[binOf(all[i])]++] = i;
}

std::vector<LineSegment> LineDetector::detect(const GradientImage& gradient) {
  std::vector<LineSegment> segments;
  if (gradient.gx.cols < 3 || gradient.gx.rows < 3) return segments;
  const int threshold = static_cast<int>(std::lround(parameters_.min_gradient * kSobelScale));
  if (table_.imageSize() != gradient.gx.size()) table_ = AContrarioTable(gradient.gx.size());
  visited_.resize(gradient.gx.total());
  findAnchors(gradient, threshold);

  RidgeWalker walker(gradient, threshold, visited_.data());
  for (const std::int32_t anchor : anchors_) {
    if (walker.visited(anchor)) continue;
    MeanGradient mean;
    walker.visit(anchor, &mean);
    chain_.assign(1, anchor);
    walker.walk(-1, &mean, &chain_);
    std::reverse(chain_.begin(), chain_.end());
    walker.walk(1, &mean, &chain_);
    if (static_cast<double>(chain_.size()) < 0.5 * parameters_.min_length_px) continue;

    places_.clear();
    for (const std::int32_t i : chain_) places_.push_back(walker.subpixel(i));
    for (std::size_t begin = 0; begin < places_.size();) {
      const StraightPiece piece = nextStraightPiece(places_, begin, parameters_.max_deviation_px);
      begin = piece.end;
      if (piece.segment.length() < parameters_.min_length_px) continue;
      const int n = static_cast<int>(piece.segment.length()) + 1;
      if (table_.meaningful(n, walker.countAligned(piece.segment, n)))
        segments.push_back(piece.segment);
    }
  }
  std::stable_sort(
      segments.begin(), segments.end(),
      [](const LineSegment& a, const LineSegment& b) { return a.length() > b.length(); });
  if (static_cast<int>(segments.size()) > parameters_.max_count)
    segments.resize(parameters_.max_count);
  return segments;
}

}  // namespace point_line_odometry
