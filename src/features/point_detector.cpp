#include "features/point_detector.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "features/coarser_corners.h"
#include "features/cv_orb_descriptor.h"
#include "features/fast_corners.h"
#include "features/orb_descriptor.h"

namespace point_line_odometry {
namespace {

constexpr int kBorder = OrbDescriptor::kBorder;
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
      const auto num_kept = std::min<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(content.size()),
                                                     parameters.max_per_cell);
      const auto end = content.begin() + num_kept;
      std::nth_element(content.begin(), end, content.end());
      std::sort(content.begin(), end);
      for (auto it = content.begin(); it != end; ++it) kept_.push_back(corners[*it & kMaxIndex]);
    }
    return kept_;
  }

 private:
  static constexpr std::uint32_t kMaxIndex = 0xFFFFFF;

  /// Sort key, strong corners first, equal ones in reading order: the inverted score in the high
  /// byte, the index in the list below.
  static std::uint32_t rank(const FastCorner& corner, std::size_t i) {
    return (static_cast<std::uint32_t>(255 - corner.score) << 24) |
           static_cast<std::uint32_t>(std::min<std::size_t>(i, kMaxIndex));
  }

  std::vector<std::vector<std::uint32_t>> cells_;
  std::vector<FastCorner> kept_;
};

}  // namespace

/// Scratch memory and tables, reused for each image.
struct PointDetector::Scratch {
  FastCorners corners;
  CellSelector selector;
  OrbDescriptor orb;
  CvOrbDescriptor cv_orb;
  cv::Mat smooth;
  cv::Mat padded;
};

PointDetector::PointDetector(const PointParameters& parameters)
    : parameters_(parameters), scratch_(std::make_unique<Scratch>()) {}
PointDetector::PointDetector(PointDetector&&) noexcept = default;
PointDetector& PointDetector::operator=(PointDetector&&) noexcept = default;
PointDetector::~PointDetector() = default;

/// Orientation and descriptor of the keypoints [begin, end of the list) of a level, whose pixels
/// are still those of that level.
void PointDetector::describe(const cv::Mat& image, std::size_t begin,
                             std::vector<Keypoint>* keypoints) {
  for (std::size_t i = begin; i < keypoints->size(); ++i) {
    Keypoint& keypoint = (*keypoints)[i];
    const cv::Point centre(cvRound(keypoint.pixel.x()), cvRound(keypoint.pixel.y()));
    keypoint.angle_rad = scratch_->orb.orientation(image, centre);
  }
  if (parameters_.descriptor == "orb") {
    scratch_->cv_orb.describe(image, begin, keypoints);
    return;
  }
  cv::GaussianBlur(image, scratch_->smooth, cv::Size(7, 7), 2.0, 2.0,
                   cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
  for (std::size_t i = begin; i < keypoints->size(); ++i) {
    Keypoint& keypoint = (*keypoints)[i];
    const cv::Point centre(cvRound(keypoint.pixel.x()), cvRound(keypoint.pixel.y()));
    keypoint.descriptor = scratch_->orb.describe(scratch_->smooth, centre, keypoint.angle_rad);
  }
}

std::vector<Keypoint> PointDetector::detect(const cv::Mat& image, const FeatureMask& mask) {
  const ImagePyramid pyramid(mask.paint(image), parameters_);
  FeatureMask of_levels = mask;
  of_levels.addLevels(pyramid);
  std::vector<Keypoint> keypoints = detectFinest(pyramid.levels.front(), of_levels);
  const std::vector<Keypoint> coarser = detectCoarser(pyramid, nullptr, of_levels);
  keypoints.insert(keypoints.end(), coarser.begin(), coarser.end());
  return keypoints;
}

std::vector<Keypoint> PointDetector::detectFinest(const cv::Mat& image, const FeatureMask& mask) {
  std::vector<Keypoint> keypoints;
  const cv::Size inside(image.cols - 2 * kBorder, image.rows - 2 * kBorder);
  if (inside.width <= 0 || inside.height <= 0) return keypoints;
  const std::vector<FastCorner>& corners =
      scratch_->corners.detect(image, parameters_.fast_threshold, kBorder,
                               {parameters_.cell_size_px, parameters_.max_per_cell}, mask.points());
  const std::vector<FastCorner>& selected = scratch_->selector.select(corners, inside, parameters_);
  keypoints.reserve(selected.size());
  for (const FastCorner& corner : selected) {
    Keypoint keypoint;
    keypoint.pixel = {static_cast<float>(corner.x), static_cast<float>(corner.y)};
    keypoint.response = corner.score;
    keypoints.push_back(keypoint);
  }
  describe(image, 0, &keypoints);
  return keypoints;
}

std::vector<Keypoint> PointDetector::detectCoarser(const ImagePyramid& pyramid, ThreadPool* threads,
                                                   const FeatureMask& mask,
                                                   const IsWanted& is_wanted) {
  std::vector<Keypoint> corners = detectCoarserCorners(pyramid, parameters_, threads, mask);
  if (is_wanted) {
    const auto is_not = [&is_wanted](const Keypoint& corner) { return !is_wanted(corner); };
    corners.erase(std::remove_if(corners.begin(), corners.end(), is_not), corners.end());
  }
  // Descriptors need a wider border than corners, which would be most of a small level.
  constexpr int kPadding = kBorder - kCoarserBorder;
  const Eigen::Vector2f margin(kPadding, kPadding);
  std::vector<Keypoint> keypoints;
  keypoints.reserve(corners.size());
  for (auto corner = corners.begin(); corner != corners.end();) {
    const int octave = corner->octave;
    const std::size_t begin = keypoints.size();
    for (; corner != corners.end() && corner->octave == octave; ++corner) {
      keypoints.push_back(*corner);
      keypoints.back().pixel = pyramid.toLevel(corner->pixel, octave) + margin;
    }
    cv::copyMakeBorder(pyramid.levels[static_cast<std::size_t>(octave)], scratch_->padded, kPadding,
                       kPadding, kPadding, kPadding, cv::BORDER_REFLECT_101);
    describe(scratch_->padded, begin, &keypoints);
    for (std::size_t i = begin; i < keypoints.size(); ++i)
      keypoints[i].pixel = pyramid.fromLevel(keypoints[i].pixel - margin, octave);
  }
  return keypoints;
}

}  // namespace point_line_odometry
