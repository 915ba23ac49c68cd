#include "point_line_odometry/point_detector.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "features/cv_orb_descriptor.h"
#include "features/fast_corners.h"
#include "features/orb_descriptor.h"

namespace point_line_odometry {
namespace {

constexpr int kBorder = OrbDescriptor::kBorder;
constexpr double kThresholdPerLevel = 0.71;  // weaker contrast shows where pixels are averaged
static_assert(kBorder >= FastCorners::kMinBorder, "the corner test reads as far");

/// The strongest corners of each cell, cells in reading order.
class CellSelector {
 public:
  /// \param corners in reading order. \param size of the area that the cells tile, whose first
  /// pixel is (kBorder, kBorder).
  const std::vector<FastCorner>& select(const std::vector<FastCorner>& corners, cv::Size size,
                                        const PointParameters& parameters) {
    const int cell = parameters.cell_size_px;
    const int columns = (size.width + cell - 1) / cell;
    const int rows = (size.height + cell - 1) / cell;
    cells_.resize(static_cast<std::size_t>(columns) * rows);
    for (std::vector<std::uint32_t>& content : cells_) content.clear();
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const int column = (corners[i].x - kBorder) / cell;
      const int row = (corners[i].y - kBorder) / cell;
      cells_[static_cast<std::size_t>(row) * columns + column].push_back(rank(corners[i], i));
    }
    kept_.clear();
    for (std::vector<std::uint32_t>& content : cells_) {
      const auto quota = std::min<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(content.size()),
                                                  parameters.max_per_cell);
      const auto end = content.begin() + quota;
      std::nth_element(content.begin(), end, content.end());
      std::sort(content.begin(), end);
      for (auto it = content.begin(); it != end; ++it) kept_.push_back(corners[*it & kMaxIndex]);
    }
    return kept_;
  }

 private:
  static constexpr std::uint32_t kMaxIndex = 0xFFFFFF;

  /// Strong ones first, among equals in reading order: the score in the high byte, turned round,
  /// and the place in the list.
  static std::uint32_t rank(const FastCorner& corner, std::size_t i) {
    return (static_cast<std::uint32_t>(255 - corner.score) << 24) |
           static_cast<std::uint32_t>(std::min<std::size_t>(i, kMaxIndex));
  }

  std::vector<std::vector<std::uint32_t>> cells_;
  std::vector<FastCorner> kept_;
};

}  // namespace

/// Scratch memory and tables, kept from image to image.
struct PointDetector::Scratch {
  FastCorners corners;
  CellSelector selector;
  OrbDescriptor orb;
  CvOrbDescriptor cv_orb;
  cv::Mat smooth;
};

PointDetector::PointDetector(const PointParameters& parameters)
    : parameters_(parameters), scratch_(std::make_unique<Scratch>()) {}
PointDetector::PointDetector(PointDetector&&) noexcept = default;
PointDetector& PointDetector::operator=(PointDetector&&) noexcept = default;
PointDetector::~PointDetector() = default;

void PointDetector::detectLevel(const cv::Mat& image, int octave,
                                std::vector<PointFeature>* features) {
  const cv::Size inside(image.cols - 2 * kBorder, image.rows - 2 * kBorder);
  if (inside.width <= 0 || inside.height <= 0) return;
  const double threshold = parameters_.fast_threshold * std::pow(kThresholdPerLevel, octave);
  const std::vector<FastCorner>& corners =
      scratch_->corners.detect(image, std::max(cvRound(threshold), 1), kBorder);
  const std::size_t begin = features->size();
  for (const FastCorner& corner : scratch_->selector.select(corners, inside, parameters_)) {
    const cv::Point centre(corner.x, corner.y);
    PointFeature feature;
    feature.pixel = {static_cast<float>(centre.x), static_cast<float>(centre.y)};
    feature.angle_rad = scratch_->orb.orientation(image, centre);
    feature.response = corner.score;
    feature.octave = octave;
    features->push_back(feature);
  }
  describe(image, begin, features);
}

/// Descriptors of the features [begin, end of the list) of a level, whose pixels are still those of
/// that level.
void PointDetector::describe(const cv::Mat& image, std::size_t begin,
                             std::vector<PointFeature>* features) {
  if (parameters_.descriptor == "orb") {
    scratch_->cv_orb.describe(image, begin, features);
    return;
  }
  cv::GaussianBlur(image, scratch_->smooth, cv::Size(7, 7), 2.0, 2.0,
                   cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
  for (std::size_t i = begin; i < features->size(); ++i) {
    PointFeature& feature = (*features)[i];
    const cv::Point centre(cvRound(feature.pixel.x()), cvRound(feature.pixel.y()));
    feature.descriptor = scratch_->orb.describe(scratch_->smooth, centre, feature.angle_rad);
  }
}

std::vector<PointFeature> PointDetector::detect(const cv::Mat& image) {
  std::vector<PointFeature> features = detectFinest(image);
  const std::vector<PointFeature> coarser = detectCoarser(ImagePyramid(image, parameters_));
  features.insert(features.end(), coarser.begin(), coarser.end());
  return features;
}

std::vector<PointFeature> PointDetector::detectFinest(const cv::Mat& image) {
  std::vector<PointFeature> features;
  detectLevel(image, 0, &features);
  return features;
}

std::vector<PointFeature> PointDetector::detectCoarser(const ImagePyramid& pyramid) {
  std::vector<PointFeature> features;
  for (std::size_t level = 1; level < pyramid.levels.size(); ++level) {
    const int octave = static_cast<int>(level);
    const std::size_t begin = features.size();
    detectLevel(pyramid.levels[level], octave, &features);
    for (std::size_t i = begin; i < features.size(); ++i)
      features[i].pixel = pyramid.fromLevel(features[i].pixel, octave);
  }
  return features;
}

}  // namespace point_line_odometry
