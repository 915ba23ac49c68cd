#include "matching/edge_aligner.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "features/line_fit.h"

namespace point_line_odometry {
namespace {

constexpr int kRadius = 3;              // [px] of the search across the segment
constexpr int kSmoothing = 2;           // passes of a filter (1, 2, 1) / 4 across it
constexpr double kLeastShare = 0.6;     // of the segment's columns in which its edge is found
constexpr int kLeastFound = 8;          // columns
constexpr int kFitRounds = 2;           // the last one without the outliers of the one before
constexpr float kGradientScale = 8.0F;  // units per grey level per pixel of Sobel's filter

// Of the gradient across the segment, of which smoothing leaves those within the radius and their
// neighbours.
constexpr int kReach = kRadius + 1 + kSmoothing;
using Profile = std::array<float, 2 * kReach + 1>;

/// How a segment lies in the image: its columns are those of the image, or of a steep segment its
/// rows.
struct Axes {
  bool steep;
  float sign;  ///< of the gradient across it

  explicit Axes(const Eigen::Vector2f& along)
      : steep(std::abs(along.y()) > std::abs(along.x())),
        sign((steep ? -along.y() : along.x()) < 0.0F ? -1.0F : 1.0F) {}

  Eigen::Vector2f swap(const Eigen::Vector2f& p) const {
    return steep ? Eigen::Vector2f(p.y(), p.x()) : p;
  }
};

/// Gradient across the segment in a column, around a row, by Sobel's filter.
Profile profileAt(const cv::Mat& image, const Axes& axes, int column, int row) {
  const auto step = static_cast<std::ptrdiff_t>(image.step[0]);
  const std::ptrdiff_t along = axes.steep ? step : 1;
  const std::ptrdiff_t across = axes.steep ? 1 : step;
  const std::uint8_t* pixel = image.data + column * along + row * across;
  std::array<int, 2 * kReach + 3> sums;  // along the segment
  for (int k = -kReach - 1; k <= kReach + 1; ++k) {
    const std::uint8_t* p = pixel + k * across;
    sums[k + kReach + 1] = p[-along] + 2 * p[0] + p[along];
  }
  Profile gradient;
  for (std::size_t k = 0; k < gradient.size(); ++k)
    gradient[k] = axes.sign * static_cast<float>(sums[k + 2] - sums[k]);
  for (int pass = 0; pass < kSmoothing; ++pass) {
    const Profile before = gradient;
    for (std::size_t k = 1; k + 1 < gradient.size(); ++k)
      gradient[k] = 0.25F * (before[k - 1] + before[k + 1]) + 0.5F * before[k];
  }
  return gradient;
}

/// Distance of the strongest gradient from the middle, by a parabola; nothing at the ends.
std::optional<float> peakOf(const Profile& gradient, float threshold) {
  const auto begin = gradient.begin() + kReach - kRadius - 1;
  const auto end = gradient.begin() + kReach + kRadius + 2;
  const auto peak = std::max_element(begin, end);
  if (peak == begin || peak + 1 == end || *peak < threshold) return std::nullopt;
  const float curvature = *(peak - 1) - 2.0F * *peak + *(peak + 1);
  if (!(curvature < 0.0F)) return std::nullopt;
  const float offset = 0.5F * (*(peak - 1) - *(peak + 1)) / curvature;
  return static_cast<float>(peak - gradient.begin()) - static_cast<float>(kReach) + offset;
}

}  // namespace

std::optional<LineSegment> alignEdge(const cv::Mat& image, const FeatureMask& mask,
                                     const LineSegment& predicted,
                                     const LineParameters& parameters) {
  if (!(predicted.length() >= 1.0F)) return std::nullopt;
  const Axes axes(predicted.end - predicted.start);
  const Eigen::Vector2f start = axes.swap(predicted.start);
  const Eigen::Vector2f end = axes.swap(predicted.end);
  const int width = axes.steep ? image.rows : image.cols;
  const int height = axes.steep ? image.cols : image.rows;
  const float slope = (end.y() - start.y()) / (end.x() - start.x());
  const float left = std::min(start.x(), end.x());
  const float right = std::max(start.x(), end.x());
  // Of a segment far outside of the image only the columns inside are visited.
  const int first = static_cast<int>(std::ceil(std::max(left, 1.0F)));
  const int last = static_cast<int>(std::floor(std::min(right, static_cast<float>(width - 2))));
  const float threshold = kGradientScale * static_cast<float>(parameters.min_gradient);
  std::vector<Eigen::Vector2f> edge;
  for (int column = first; column <= last; ++column) {
    const float v = start.y() + slope * (static_cast<float>(column) - start.x());
    if (!(v >= kReach + 1.5F && v <= static_cast<float>(height) - kReach - 2.5F)) continue;
    const int row = static_cast<int>(std::lround(v));
    const auto pixel =
        axes.swap(Eigen::Vector2f(static_cast<float>(column), static_cast<float>(row)));
    if (!mask.empty() && mask.edges().at<std::uint8_t>(static_cast<int>(pixel.y()),
                                                       static_cast<int>(pixel.x())) == 0)
      continue;
    if (const auto peak = peakOf(profileAt(image, axes, column, row), threshold))
      edge.emplace_back(static_cast<float>(column), static_cast<float>(row) + *peak);
  }
  const double least = std::max<double>(kLeastFound, kLeastShare * (right - left));
  const auto max_deviation = static_cast<float>(parameters.max_deviation_px);
  LineFit fit;
  for (int round = 0; round < kFitRounds; ++round) {
    if (static_cast<double>(edge.size()) < least) return std::nullopt;
    fit = LineFit();
    for (const Eigen::Vector2f& pixel : edge) fit.add(pixel);
    fit.solve();
    const auto is_outlier = [&](const Eigen::Vector2f& p) {
      return fit.distance(p) > max_deviation;
    };
    edge.erase(std::remove_if(edge.begin(), edge.end(), is_outlier), edge.end());
  }
  if (static_cast<double>(edge.size()) < least ||
      fit.normalVariance() > 0.25 * max_deviation * max_deviation)
    return std::nullopt;
  return LineSegment{axes.swap(fit.project(start)), axes.swap(fit.project(end))};
}

}  // namespace point_line_odometry
