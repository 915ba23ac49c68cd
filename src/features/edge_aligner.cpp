#include "features/edge_aligner.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <vector>

#include "features/line_fit.h"

namespace point_line_odometry {
namespace {

constexpr int kRadius = 3;           // [px] of the search across the segment
constexpr int kStep = 2;             // columns to the next one: as exact as every one, which share
                                     // their pixels
constexpr double kLeastShare = 0.6;  // of the segment's columns in which its edge is found
constexpr int kLeastFound = 8;       // columns
constexpr int kFitRounds = 2;        // the last one without the outliers of the one before
constexpr int kGradientScale = 8;    // units per grey level per pixel of Sobel's filter

// The gradient across the segment is smoothed by a binomial filter; of the radius and of one pixel
// beyond, which tells a maximum from the flank of another edge.
constexpr int kSmoothing[] = {1, 4, 6, 4, 1};
constexpr int kSmoothingScale = 16;
constexpr int kTaps = static_cast<int>(std::size(kSmoothing));
constexpr int kReach = kRadius + 1 + kTaps / 2;
using Profile = std::array<int, 2 * kRadius + 3>;

/// How a segment lies in the image: its columns are those of the image, or of a steep segment its
/// rows.
struct Axes {
  bool steep;
  int sign;  ///< of the gradient across it

  explicit Axes(const Eigen::Vector2f& along)
      : steep(std::abs(along.y()) > std::abs(along.x())),
        sign((steep ? -along.y() : along.x()) < 0.0F ? -1 : 1) {}

  Eigen::Vector2f swap(const Eigen::Vector2f& p) const {
    return steep ? Eigen::Vector2f(p.y(), p.x()) : p;
  }
};

/// Smoothed gradient across the segment in a column, around a row, by Sobel's filter
/// [1 / (8 kSmoothingScale) grey levels per pixel].
Profile profileAt(const cv::Mat& image, const Axes& axes, int column, int row) {
  const auto step = static_cast<std::ptrdiff_t>(image.step[0]);
  const std::ptrdiff_t along = axes.steep ? step : 1;
  const std::ptrdiff_t across = axes.steep ? 1 : step;
  const std::uint8_t* pixel = image.data + column * along + (row - kReach - 1) * across;
  std::array<int, 2 * kReach + 3> sums;  // along the segment
  for (std::size_t k = 0; k < sums.size(); ++k, pixel += across)
    sums[k] = pixel[-along] + 2 * pixel[0] + pixel[along];
  std::array<int, 2 * kReach + 1> gradient;
  for (std::size_t k = 0; k < gradient.size(); ++k)
    gradient[k] = axes.sign * (sums[k + 2] - sums[k]);
  Profile smooth{};
  for (std::size_t k = 0; k < smooth.size(); ++k) {
    for (std::size_t tap = 0; tap < kTaps; ++tap) smooth[k] += kSmoothing[tap] * gradient[k + tap];
  }
  return smooth;
}

/// Distance of the strongest gradient from the middle, by a parabola; nothing at the ends.
std::optional<float> peakOf(const Profile& gradient, int threshold) {
  const auto peak = std::max_element(gradient.begin(), gradient.end());
  if (peak == gradient.begin() || peak + 1 == gradient.end() || *peak < threshold)
    return std::nullopt;
  const int curvature = *(peak - 1) - 2 * *peak + *(peak + 1);
  if (curvature >= 0) return std::nullopt;
  const float offset =
      0.5F * static_cast<float>(*(peak - 1) - *(peak + 1)) / static_cast<float>(curvature);
  return static_cast<float>(peak - gradient.begin() - kRadius - 1) + offset;
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
  const auto threshold =
      static_cast<int>(kSmoothingScale * kGradientScale * parameters.min_gradient);
  std::vector<Eigen::Vector2f> edge;
  for (int column = first; column <= last; column += kStep) {
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
  const double least = std::max<double>(kLeastFound, kLeastShare * (right - left)) / kStep;
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
