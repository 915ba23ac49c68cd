#include "features/feature_mask.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "common/area_reduction.h"
#include "common/same_image.h"

namespace point_line_odometry {
namespace {

constexpr uchar kVisible = 255;
constexpr double kGrey = 128.0;  // of masked pixels

/// Visible pixels without a masked one within `margin` rows and columns.
cv::Mat awayFromMasked(const cv::Mat& visible, int margin) {
  cv::Mat sums;
  const int side = 2 * margin + 1;
  cv::boxFilter(visible == 0, sums, CV_32S, {side, side}, {-1, -1}, false,
                cv::BORDER_CONSTANT | cv::BORDER_ISOLATED);
  return sums == 0;
}

bool isSet(const cv::Mat& mask, float x, float y) {
  const int column = cvRound(x);
  const int row = cvRound(y);
  return column >= 0 && row >= 0 && column < mask.cols && row < mask.rows &&
         mask.ptr<uchar>(row)[column] != 0;
}

/// A position on a segment, from its start on [0, 1].
Eigen::Vector2f along(const LineSegment& segment, int i, int last) {
  const float t = static_cast<float>(i) / static_cast<float>(last);
  return segment.start + t * (segment.end - segment.start);
}

int stepsOf(const LineSegment& segment) {
  constexpr float kPerPixel = 2.0F;
  constexpr float kMost = 1e5F;
  return std::max(static_cast<int>(std::ceil(kPerPixel * std::min(segment.length(), kMost))), 1);
}

/// The longest piece of a segment where a mask is not 0; nothing if there is none.
std::optional<LineSegment> longestPiece(const LineSegment& segment, const cv::Mat& mask) {
  const int last = stepsOf(segment);
  int best_begin = 0;
  int best_end = -1;
  int begin = 0;  // of the piece that ends at i
  for (int i = 0; i <= last; ++i) {
    // Detectors' segments may end a little outside the image.
    const Eigen::Vector2f p = along(segment, i, last);
    const float x = std::clamp(p.x(), 0.0F, static_cast<float>(mask.cols - 1));
    const float y = std::clamp(p.y(), 0.0F, static_cast<float>(mask.rows - 1));
    if (!isSet(mask, x, y)) {
      begin = i + 1;
    } else if (i - begin > best_end - best_begin) {
      best_begin = begin;
      best_end = i;
    }
  }
  if (best_end < 0) return std::nullopt;
  if (best_begin == 0 && best_end == last) return segment;
  return LineSegment{along(segment, best_begin, last), along(segment, best_end, last)};
}

}  // namespace

/// Of the image and the coarser levels.
struct FeatureMask::Levels {
  std::vector<cv::Mat> visible;
  std::vector<cv::Mat> patches;          // where patches may be
  std::map<int, FeatureMask> of_octave;  // those that were asked for
  std::optional<FeatureMask> half;       // likewise
};

cv::Mat binaryMask(const cv::Mat& mask) { return mask != 0; }

FeatureMask::FeatureMask(const cv::Mat& mask) {
  if (mask.empty() || cv::countNonZero(mask) == static_cast<int>(mask.total())) return;
  visible_ = binaryMask(mask);
  points_ = awayFromMasked(visible_, kPointMargin);
  edges_ = awayFromMasked(visible_, kEdgeMargin);
  levels_ = std::make_shared<Levels>();
  levels_->visible = {visible_};
  levels_->patches = {awayFromMasked(visible_, kPatchMargin)};
}

cv::Mat FeatureMask::paint(const cv::Mat& image) const {
  if (empty()) return image;
  cv::Mat painted = image.clone();
  painted.setTo(cv::Scalar(kGrey), visible_ == 0);
  return painted;
}

/// A pixel of a level is visible if all that it covers are.
void FeatureMask::addLevels(const ImagePyramid& image) {
  if (empty()) return;
  for (std::size_t i = 1; i < image.levels.size(); ++i) {
    const cv::Size size = image.levels[i].size();
    std::vector<cv::Mat>& visible = levels_->visible;
    if (i < visible.size() && visible[i].size() == size) continue;
    visible.resize(i);
    levels_->patches.resize(i);
    levels_->of_octave.clear();
    cv::Mat mean;
    cv::resize(visible[i - 1], mean, size, 0.0, 0.0, cv::INTER_AREA);
    visible.emplace_back(mean == kVisible);
    levels_->patches.push_back(awayFromMasked(visible[i], kPatchMargin));
  }
}

const FeatureMask& FeatureMask::ofLevel(int octave) const {
  if (empty()) return *this;
  const auto found = levels_->of_octave.find(octave);
  if (found != levels_->of_octave.end()) return found->second;
  const cv::Mat& visible = levels_->visible[static_cast<std::size_t>(octave)];
  return levels_->of_octave.emplace(octave, FeatureMask(visible)).first->second;
}

const FeatureMask& FeatureMask::half() const {
  if (empty()) return *this;
  if (!levels_->half) {
    cv::Mat mean;
    halve(visible_, &mean);
    levels_->half = FeatureMask(mean == kVisible);
  }
  return *levels_->half;
}

bool FeatureMask::allowsPatch(const Eigen::Vector2f& level_px, int octave) const {
  if (empty()) return true;
  const auto level = static_cast<std::size_t>(octave);
  return level < levels_->patches.size() &&
         isSet(levels_->patches[level], level_px.x(), level_px.y());
}

bool FeatureMask::hides(const LineSegment& segment) const {
  if (empty()) return false;
  const int last = stepsOf(segment);
  int masked = 0;
  int inside = 0;
  for (int i = 0; i <= last; ++i) {
    const Eigen::Vector2f p = along(segment, i, last);
    if (!(p.x() > -0.5F && p.y() > -0.5F && p.x() < static_cast<float>(visible_.cols) - 0.5F &&
          p.y() < static_cast<float>(visible_.rows) - 0.5F))
      continue;
    ++inside;
    masked += isSet(visible_, p.x(), p.y()) ? 0 : 1;
  }
  return 2 * masked > inside;
}

void FeatureMask::cut(double min_length_px, std::vector<LineSegment>* segments) const {
  if (empty()) return;
  std::vector<LineSegment> kept;
  for (const LineSegment& segment : *segments) {
    const std::optional<LineSegment> piece = longestPiece(segment, edges_);
    if (piece && piece->length() >= min_length_px) kept.push_back(*piece);
  }
  *segments = std::move(kept);
}

double FeatureMask::share() const {
  if (empty()) return 0.0;
  return 1.0 -
         static_cast<double>(cv::countNonZero(visible_)) / static_cast<double>(visible_.total());
}

const StereoMasks& StereoMaskCache::of(const StereoImages& images) {
  const auto take = [](const cv::Mat& mask, cv::Mat* last, FeatureMask* made) {
    if (haveSameBytes(mask, *last)) return;
    *last = mask.clone();
    *made = FeatureMask(mask);
  };
  take(images.left_mask, &left_, &masks_.left);
  take(images.right_mask, &right_, &masks_.right);
  return masks_;
}

}  // namespace point_line_odometry
