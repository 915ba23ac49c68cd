#include "point_line_odometry/line_detector.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

namespace point_line_odometry {
namespace {

constexpr float kSobelScale = 8.0F;                      // Sobel units per grey level per pixel
constexpr float kCosTolerance2 = 0.853553391F;           // cos^2(22.5 deg): LSD's angle tolerance
constexpr double kAlignedProbability = 1.0 / 8.0;        // that a random gradient is within it
constexpr int kMaxGap = 7;                               // pixels a chain may jump, e.g. at a crossing
constexpr int kSeedPixels = 8;                           // first fit of a segment
constexpr int kMaxOutliersInRow = 4;                     // then the segment ends

/// Read-only view of the gradient with the tests that walking needs.
class GradientView {
 public:
  GradientView(const GradientImage& gradient, int threshold)
      : gx_(gradient.gx.ptr<short>()),
        gy_(gradient.gy.ptr<short>()),
        magnitude_(gradient.magnitude.ptr<ushort>()),
        stride_(gradient.gx.step1()),
        width_(gradient.gx.cols),
        height_(gradient.gx.rows),
        threshold_(threshold) {}

  bool contains(int x, int y) const { return x >= 1 && y >= 1 && x < width_ - 1 && y < height_ - 1; }
  bool isEdge(int x, int y) const { return magnitude(x, y) >= threshold_; }
  int gx(int x, int y) const { return gx_[index(x, y)]; }
  int gy(int x, int y) const { return gy_[index(x, y)]; }
  int magnitude(int x, int y) const { return magnitude_[index(x, y)]; }

  /// True if the edge runs more vertically than horizontally.
  bool steep(int x, int y) const { return std::abs(gx(x, y)) >= std::abs(gy(x, y)); }

  /// Place of the ridge through a pixel, by a parabola across the edge.
  Eigen::Vector2f subpixel(int x, int y) const {
    const bool across_x = steep(x, y);
    const std::size_t step = across_x ? 1 : stride_;
    const std::size_t i = index(x, y);
    const float before = magnitude_[i - step];
    const float here = magnitude_[i];
    const float after = magnitude_[i + step];
    const float curvature = before - 2.0F * here + after;
    const float offset =
        curvature < 0.0F ? std::clamp(0.5F * (before - after) / curvature, -0.5F, 0.5F) : 0.0F;
    return across_x ? Eigen::Vector2f(x + offset, y) : Eigen::Vector2f(x, y + offset);
  }

 private:
  std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * stride_ + x; }

  const short* gx_;
  const short* gy_;
  const ushort* magnitude_;
  std::size_t stride_;
  int width_;
  int height_;
  int threshold_;
};

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
};

/// Total least squares fit of a straight line to pixels, from running sums about the first pixel.
class LineFit {
 public:
  void add(const Eigen::Vector2f& p) {
    if (count_ == 0) origin_ = p;
    const Eigen::Vector2d q = (p - origin_).cast<double>();
    ++count_;
    sum_ += q;
    sum_xx_ += q.x() * q.x();
    sum_xy_ += q.x() * q.y();
    sum_yy_ += q.y() * q.y();
  }

  void solve() {
    const Eigen::Vector2d mean = sum_ / count_;
    const double xx = sum_xx_ / count_ - mean.x() * mean.x();
    const double xy = sum_xy_ / count_ - mean.x() * mean.y();
    const double yy = sum_yy_ / count_ - mean.y() * mean.y();
    const double half_difference = 0.5 * (xx - yy);
    const double root = std::sqrt(half_difference * half_difference + xy * xy);
    const Eigen::Vector2d along = half_difference >= 0.0 ? Eigen::Vector2d(half_difference + root, xy)
                                                         : Eigen::Vector2d(xy, root - half_difference);
    const double norm = along.norm();
    direction_ = norm > 0.0 ? Eigen::Vector2f((along / norm).cast<float>()) : Eigen::Vector2f(1.0F, 0.0F);
    middle_ = origin_ + mean.cast<float>();
    variance_across_ = std::max(0.0, 0.5 * (xx + yy) - root);
  }

  int count() const { return count_; }
  double varianceAcross() const { return variance_across_; }
  float distance(const Eigen::Vector2f& p) const {
    const Eigen::Vector2f q = p - middle_;
    return std::abs(direction_.x() * q.y() - direction_.y() * q.x());
  }
  Eigen::Vector2f project(const Eigen::Vector2f& p) const {
    return middle_ + direction_ * direction_.dot(p - middle_);
  }

 private:
  Eigen::Vector2f origin_ = Eigen::Vector2f::Zero();
  Eigen::Vector2d sum_ = Eigen::Vector2d::Zero();
  double sum_xx_ = 0.0;
  double sum_xy_ = 0.0;
  double sum_yy_ = 0.0;
  int count_ = 0;
  Eigen::Vector2f direction_ = Eigen::Vector2f(1.0F, 0.0F);
  Eigen::Vector2f middle_ = Eigen::Vector2f::Zero();
  double variance_across_ = 0.0;
};

/// Walks from a pixel along the ridge; `sign` +1 follows the direction with the brighter side on the right hand.
class ChainWalker {
 public:
  ChainWalker(const GradientView& gradient, const cv::Mat& visited) : gradient_(gradient), visited_(visited) {}

  /// Moves (x, y) one pixel on along the ridge, or over a gap; false at the end of the chain.
  bool step(int sign, const MeanGradient& mean, int* x, int* y) const {
    return stepToNeighbour(sign, mean, x, y) || jump(sign, mean, x, y);
  }

 private:
  bool usable(int x, int y, const MeanGradient& mean) const {
    return gradient_.contains(x, y) && gradient_.isEdge(x, y) && !visited_.at<uchar>(y, x) &&
           mean.agrees(gradient_.gx(x, y), gradient_.gy(x, y));
  }

  /// The strongest usable one of three pixels across the walk at (x, y).
  bool strongestAcross(bool steep, const MeanGradient& mean, int* x, int* y) const {
    int best = 0;
    int best_shift = 0;
    for (const int shift : {0, -1, 1}) {
      const int cx = *x + (steep ? shift : 0);
      const int cy = *y + (steep ? 0 : shift);
      if (usable(cx, cy, mean) && gradient_.magnitude(cx, cy) > best) {
        best = gradient_.magnitude(cx, cy);
        best_shift = shift;
      }
    }
    (steep ? *x : *y) += best_shift;
    return best > 0;
  }

  bool stepToNeighbour(int sign, const MeanGradient& mean, int* x, int* y) const {
    const bool steep = std::abs(mean.x) >= std::abs(mean.y);
    int nx = *x;
    int ny = *y;
    if (steep) {
      ny += mean.x > 0.0F ? -sign : sign;
    } else {
      nx += mean.y > 0.0F ? sign : -sign;
    }
    if (!strongestAcross(steep, mean, &nx, &ny)) return false;
    *x = nx;
    *y = ny;
    return true;
  }

  bool jump(int sign, const MeanGradient& mean, int* x, int* y) const {
    const bool steep = std::abs(mean.x) >= std::abs(mean.y);
    const float scale = sign / std::max(std::abs(mean.x), std::abs(mean.y));
    for (int gap = 2; gap <= kMaxGap; ++gap) {
      int nx = *x + static_cast<int>(std::lround(mean.y * scale * gap));
      int ny = *y - static_cast<int>(std::lround(mean.x * scale * gap));
      if (!strongestAcross(steep, mean, &nx, &ny)) continue;
      int ahead_x = nx;
      int ahead_y = ny;
      if (!stepToNeighbour(sign, mean, &ahead_x, &ahead_y)) continue;
      *x = nx;
      *y = ny;
      return true;
    }
    return false;
  }

  const GradientView& gradient_;
  const cv::Mat& visited_;
};

/// Fewest aligned pixels that make a segment of n pixels meaningful: number of false alarms <= 1 in the a-contrario model
/// of von Gioi et al. 2010, sum_{i >= k} C(n, i) p^i (1 - p)^(n - i) * (width * height)^(5/2) <= 1.
int fewestAlignedPixels(int n, double log10_tests) {
  const double log_p = std::log10(kAlignedProbability);
  const double log_q = std::log10(1.0 - kAlignedProbability);
  double log_binomial = 0.0;
  double tail = 0.0;
  for (int k = n; k > 0; --k) {
    tail += std::pow(10.0, log_binomial + k * log_p + (n - k) * log_q + log10_tests);
    if (tail > 1.0) return k + 1;
    log_binomial += std::log10(static_cast<double>(k)) - std::log10(static_cast<double>(n - k + 1));
  }
  return 0;
}

/// The same for every n, looked up; beyond the table the share of its last entry is asked for, which is stricter.
class ValidationTable {
 public:
  ValidationTable(int width, int height) {
    const double log10_tests = 2.5 * std::log10(static_cast<double>(width) * height);
    for (int n = 0; n < static_cast<int>(fewest_.size()); ++n) fewest_[n] = fewestAlignedPixels(n, log10_tests);
  }
  bool meaningful(int n, int aligned) const {
    const int last = static_cast<int>(fewest_.size()) - 1;
    if (n <= last) return aligned >= fewest_[n];
    return static_cast<double>(aligned) / n >= static_cast<double>(fewest_[last]) / last;
  }

 private:
  std::array<int, 257> fewest_{};
};

/// Pixels along a segment, one per pixel of length, and how many of their gradients point across it.
bool isMeaningful(const LineSegment& segment, const GradientView& gradient, const ValidationTable& table) {
  const Eigen::Vector2f direction = segment.direction();
  MeanGradient normal;
  normal.add(-direction.y(), direction.x());
  const int n = static_cast<int>(segment.length()) + 1;
  int aligned = 0;
  for (int i = 0; i < n; ++i) {
    const Eigen::Vector2f p = segment.start + direction * static_cast<float>(i);
    const int x = static_cast<int>(std::lround(p.x()));
    const int y = static_cast<int>(std::lround(p.y()));
    if (!gradient.contains(x, y)) continue;
    aligned += normal.agrees(gradient.gx(x, y), gradient.gy(x, y)) ? 1 : 0;
  }
  return table.meaningful(n, aligned);
}

}  // namespace

GradientImage computeGradient(const cv::Mat& image) {
  GradientImage gradient;
  cv::Mat smooth;
  cv::GaussianBlur(image, smooth, cv::Size(5, 5), 1.0, 1.0, cv::BORDER_REPLICATE);
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

void LineDetector::findAnchors(const GradientImage& gradient, int threshold) {
  constexpr int kBins = 256;
  constexpr int kBinShift = 4;
  std::array<std::vector<ChainPixel>, kBins> bins;
  const std::size_t stride = gradient.magnitude.step1();
  for (int y = 1; y < gradient.magnitude.rows - 1; ++y) {
    const ushort* magnitude = gradient.magnitude.ptr<ushort>(y);
    const short* gx = gradient.gx.ptr<short>(y);
    const short* gy = gradient.gy.ptr<short>(y);
    for (int x = 1; x < gradient.magnitude.cols - 1; ++x) {
      const int here = magnitude[x];
      if (here < threshold) continue;
      const std::ptrdiff_t step =
          std::abs(gx[x]) >= std::abs(gy[x]) ? 1 : static_cast<std::ptrdiff_t>(stride);
      if (here <= magnitude[x - step] || here < magnitude[x + step]) continue;
      bins[std::min(here >> kBinShift, kBins - 1)].push_back({x, y});
    }
  }
  anchors_.clear();
  for (int bin = kBins - 1; bin >= 0; --bin) {
    anchors_.insert(anchors_.end(), bins[bin].begin(), bins[bin].end());
  }
}

std::vector<LineSegment> LineDetector::detect(const GradientImage& gradient) {
  const int threshold = static_cast<int>(std::lround(parameters_.min_gradient * kSobelScale));
  const GradientView view(gradient, threshold);
  const ValidationTable table(gradient.gx.cols, gradient.gx.rows);
  visited_.create(gradient.gx.size(), CV_8UC1);
  visited_.setTo(0);
  findAnchors(gradient, threshold);

  std::vector<LineSegment> segments;
  const ChainWalker walker(view, visited_);
  for (const ChainPixel& anchor : anchors_) {
    if (visited_.at<uchar>(anchor.y, anchor.x)) continue;
    MeanGradient mean;
    mean.add(view.gx(anchor.x, anchor.y), view.gy(anchor.x, anchor.y));
    visited_.at<uchar>(anchor.y, anchor.x) = 1;
    chain_.assign(1, anchor);
    for (const int sign : {-1, 1}) {
      int x = anchor.x;
      int y = anchor.y;
      while (walker.step(sign, mean, &x, &y)) {
        visited_.at<uchar>(y, x) = 1;
        mean.add(view.gx(x, y), view.gy(x, y));
        chain_.push_back({x, y});
      }
      if (sign < 0) std::reverse(chain_.begin(), chain_.end());
    }
    if (static_cast<double>(chain_.size()) < 0.5 * parameters_.min_length_px) continue;
    std::vector<Eigen::Vector2f> pixels;
    pixels.reserve(chain_.size());
    for (const ChainPixel& p : chain_) pixels.push_back(view.subpixel(p.x, p.y));

    // Cut the chain into straight pieces: a seed is fitted, and grown while pixels lie on it.
    std::size_t begin = 0;
    while (begin + kSeedPixels <= pixels.size()) {
      LineFit fit;
      for (std::size_t i = begin; i < begin + kSeedPixels; ++i) fit.add(pixels[i]);
      fit.solve();
      const double deviation = parameters_.max_deviation_px;
      if (fit.varianceAcross() > 0.25 * deviation * deviation) {
        ++begin;
        continue;
      }
      std::size_t last_inlier = begin + kSeedPixels - 1;
      int next_solve = 2 * kSeedPixels;
      for (std::size_t i = last_inlier + 1; i < pixels.size() && i - last_inlier <= kMaxOutliersInRow; ++i) {
        if (fit.distance(pixels[i]) > deviation) continue;
        fit.add(pixels[i]);
        last_inlier = i;
        if (fit.count() >= next_solve) {
          fit.solve();
          next_solve += next_solve / 4;
        }
      }
      fit.solve();
      const LineSegment segment{fit.project(pixels[begin]), fit.project(pixels[last_inlier])};
      if (segment.length() >= parameters_.min_length_px && isMeaningful(segment, view, table)) {
        segments.push_back(segment);
      }
      begin = last_inlier + 1;
    }
  }
  std::stable_sort(segments.begin(), segments.end(),
                   [](const LineSegment& a, const LineSegment& b) { return a.length() > b.length(); });
  if (static_cast<int>(segments.size()) > parameters_.max_count) segments.resize(parameters_.max_count);
  return segments;
}

}  // namespace point_line_odometry
