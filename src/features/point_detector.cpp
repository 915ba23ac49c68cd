#include "point_line_odometry/point_detector.h"

#include <algorithm>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

namespace point_line_odometry {
namespace {

constexpr int kPatchRadius = 15;    // of the patch that gives the orientation
constexpr int kPatternRadius = 13;  // of the comparisons; turned ones reach sqrt(2) further
constexpr int kBorder = 20;         // px from the image's border that patch and pattern need
constexpr double kPi = 3.14159265358979323846;

/// Approximately normal numbers from a generator that the standard fixes, so that descriptors are
/// the same everywhere.
class PatternGenerator {
 public:
  /// One coordinate, standard deviation a fifth of the patch as in BRIEF (Calonder et al. 2010),
  /// within the pattern.
  double coordinate() {
    const double sigma = (2 * kPatchRadius + 1) / 5.0;
    for (;;) {
      double sum = 0.0;
      for (int i = 0; i < 12; ++i) sum += static_cast<double>(generator_()) / std::mt19937::max();
      const double value = sigma * (sum - 6.0);
      if (std::abs(value) <= kPatternRadius) return value;
    }
  }

 private:
  std::mt19937 generator_{20210409U};
};

/// Direction from the centre of a disc to its centre of intensity [rad].
float orientation(const cv::Mat& image, cv::Point centre) {
  int moment_x = 0;
  int moment_y = 0;
  for (int dy = -kPatchRadius; dy <= kPatchRadius; ++dy) {
    const int half_width = static_cast<int>(
        std::sqrt(static_cast<float>(kPatchRadius * kPatchRadius - dy * dy)) + 0.5F);
    const uchar* row = image.ptr<uchar>(centre.y + dy) + centre.x;
    int row_sum = 0;
    for (int dx = -half_width; dx <= half_width; ++dx) {
      row_sum += row[dx];
      moment_x += dx * row[dx];
    }
    moment_y += dy * row_sum;
  }
  return cv::fastAtan2(static_cast<float>(moment_y), static_cast<float>(moment_x)) *
         static_cast<float>(kPi / 180.0);
}

/// The strongest corners of each cell, cells in reading order.
std::vector<cv::KeyPoint> strongestPerCell(const std::vector<cv::KeyPoint>& corners, cv::Size size,
                                           const PointParameters& parameters) {
  const int cell = parameters.cell_size_px;
  const int columns = (size.width + cell - 1) / cell;
  const int rows = (size.height + cell - 1) / cell;
  std::vector<std::vector<cv::KeyPoint>> cells(static_cast<std::size_t>(columns) * rows);
  for (const cv::KeyPoint& corner : corners) {
    const int column = static_cast<int>(corner.pt.x) / cell;
    const int row = static_cast<int>(corner.pt.y) / cell;
    cells[static_cast<std::size_t>(row) * columns + column].push_back(corner);
  }
  std::vector<cv::KeyPoint> kept;
  const auto quota = static_cast<std::size_t>(parameters.max_per_cell);
  for (std::vector<cv::KeyPoint>& content : cells) {
    std::stable_sort(
        content.begin(), content.end(),
        [](const cv::KeyPoint& a, const cv::KeyPoint& b) { return a.response > b.response; });
    if (content.size() > quota) content.resize(quota);
    kept.insert(kept.end(), content.begin(), content.end());
  }
  return kept;
}

}  // namespace

PointDetector::PointDetector(const PointParameters& parameters) : parameters_(parameters) {
  PatternGenerator generator;
  std::array<std::array<double, 4>, kBits> upright;
  for (auto& comparison : upright) {
    for (double& coordinate : comparison) coordinate = generator.coordinate();
  }
  for (int rotation = 0; rotation < kRotations; ++rotation) {
    const double angle = 2.0 * kPi * rotation / kRotations;
    const double c = std::cos(angle);
    const double s = std::sin(angle);
    const auto turned = [c, s](double x, double y) {
      return cv::Point(static_cast<int>(std::lround(c * x - s * y)),
                       static_cast<int>(std::lround(s * x + c * y)));
    };
    for (int bit = 0; bit < kBits; ++bit) {
      const auto& comparison = upright[bit];
      patterns_[rotation][bit] = {turned(comparison[0], comparison[1]),
                                  turned(comparison[2], comparison[3])};
    }
  }
}

Descriptor PointDetector::describe(const cv::Mat& smooth, cv::Point centre, float angle_rad) const {
  const int rotation =
      static_cast<int>(std::lround(angle_rad * kRotations / (2.0 * kPi))) % kRotations;
  const Pattern& pattern = patterns_[rotation];
  const auto step = static_cast<std::ptrdiff_t>(smooth.step1());
  const uchar* origin = smooth.ptr<uchar>(centre.y) + centre.x;
  Descriptor descriptor{};
  for (int bit = 0; bit < kBits; ++bit) {
    const Comparison& c = pattern[bit];
    const bool darker =
        origin[c.first.y * step + c.first.x] < origin[c.second.y * step + c.second.x];
    descriptor[bit / 64] |= static_cast<std::uint64_t>(darker) << (bit % 64);
  }
  return descriptor;
}

void PointDetector::detectLevel(const cv::Mat& image, int octave,
                                std::vector<PointFeature>* features) const {
  if (image.cols <= 2 * kBorder || image.rows <= 2 * kBorder) return;
  const cv::Rect inside(kBorder, kBorder, image.cols - 2 * kBorder, image.rows - 2 * kBorder);
  std::vector<cv::KeyPoint> corners;
  cv::FAST(image(inside), corners, parameters_.fast_threshold, true);

  cv::Mat smooth;
  cv::GaussianBlur(image, smooth, cv::Size(7, 7), 2.0, 2.0,
                   cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
  const auto scale = static_cast<float>(std::pow(parameters_.scale_factor, octave));
  for (const cv::KeyPoint& corner : strongestPerCell(corners, inside.size(), parameters_)) {
    const cv::Point centre(static_cast<int>(corner.pt.x) + kBorder,
                           static_cast<int>(corner.pt.y) + kBorder);
    PointFeature feature;
    // Centres of pixels: level pixel i covers full-resolution pixels (i + 0.5) * scale - 0.5.
    feature.pixel = {(static_cast<float>(centre.x) + 0.5F) * scale - 0.5F,
                     (static_cast<float>(centre.y) + 0.5F) * scale - 0.5F};
    feature.angle_rad = orientation(image, centre);
    feature.response = corner.response;
    feature.octave = octave;
    feature.descriptor = describe(smooth, centre, feature.angle_rad);
    features->push_back(feature);
  }
}

std::vector<PointFeature> PointDetector::detect(const cv::Mat& image) const {
  std::vector<PointFeature> features;
  for (int octave = 0; octave < parameters_.levels; ++octave) {
    if (octave == 0) {
      detectLevel(image, octave, &features);
      continue;
    }
    const double scale = std::pow(parameters_.scale_factor, octave);
    const cv::Size size(cvRound(image.cols / scale), cvRound(image.rows / scale));
    if (size.width <= 2 * kBorder || size.height <= 2 * kBorder) break;
    cv::Mat smaller;
    cv::resize(image, smaller, size, 0, 0, cv::INTER_LINEAR);
    detectLevel(smaller, octave, &features);
  }
  return features;
}

}  // namespace point_line_odometry
