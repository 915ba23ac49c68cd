#include "matching/line_matcher.h"

#include <algorithm>
#include <cmath>

#include "matching/cross_check.h"
#include "matching/descriptor_distance.h"
#include "matching/segment_grid.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {
namespace {

constexpr float kCollinearPx = 2.0F;  // pieces of one edge do not compete with each other

struct SegmentLimits {
  float min_cosine;
  float min_overlap;
  float min_length_ratio;

  explicit SegmentLimits(const MatchingParameters& parameters)
      : min_cosine(static_cast<float>(
            std::cos(parameters.max_line_angle_deg * 3.14159265358979323846 / 180.0))),
        min_overlap(static_cast<float>(parameters.min_line_overlap)),
        min_length_ratio(static_cast<float>(parameters.min_line_length_ratio)) {}
};

/// Length of the common part of two intervals over the length of the shorter.
float overlapRatio(float a0, float a1, float b0, float b1) {
  const float common =
      std::min(std::max(a0, a1), std::max(b0, b1)) - std::max(std::min(a0, a1), std::min(b0, b1));
  const float shorter = std::min(std::abs(a1 - a0), std::abs(b1 - b0));
  return shorter > 0.0F ? common / shorter : 0.0F;
}

/// A segment with its direction and length precomputed.
struct Segment : LineSegment {
  Eigen::Vector2f along;
  float size;

  Segment(const LineSegment& segment)  // NOLINT(runtime/explicit): the same segment
      : LineSegment(segment), along(segment.direction()), size(segment.length()) {}
};

/// Direction and length: the geometric constraint of stereo and circular matching.
bool alike(const Segment& a, const Segment& b, const SegmentLimits& limits) {
  return a.along.dot(b.along) >= limits.min_cosine &&
         std::min(a.size, b.size) >= limits.min_length_ratio * std::max(a.size, b.size);
}

float distanceToInfiniteLine(const Segment& line, const Eigen::Vector2f& p) {
  const Eigen::Vector2f q = p - line.start;
  return std::abs(line.along.x() * q.y() - line.along.y() * q.x());
}

bool collinear(const Segment& a, const Segment& b) {
  return distanceToInfiniteLine(a, b.start) < kCollinearPx &&
         distanceToInfiniteLine(a, b.end) < kCollinearPx;
}

struct LineViews {
  std::vector<Segment> segments;
  std::vector<Descriptor> descriptors;

  void add(const LineSegment& segment, const Descriptor& descriptor) {
    segments.emplace_back(segment);
    descriptors.push_back(descriptor);
  }
};

LineViews viewsOf(const std::vector<LineFeature>& features) {
  LineViews views;
  for (const LineFeature& feature : features) views.add(feature.segment, feature.descriptor);
  return views;
}

/// Finds the nearest descriptor among the segments that satisfy a constraint. The ratio test
/// ignores pieces of the same edge.
class LineSearch {
 public:
  LineSearch(const LineViews& candidates, const MatchingParameters& parameters)
      : candidates_(candidates),
        parameters_(parameters),
        grid_({candidates.segments.begin(), candidates.segments.end()}) {}

  /// The nearest of the candidates that touch the box and for which `fits(segment)` is true, or -1.
  template <typename Fits>
  int best(const Descriptor& descriptor, const Eigen::AlignedBox2f& box, Fits&& fits) {
    indices_.clear();
    grid_.forEachNear(box, [&](int k) {
      if (fits(candidates_.segments[k])) indices_.push_back(k);
    });
    distances_.resize(indices_.size());
    hammingDistances(descriptor, candidates_.descriptors.data(), indices_.data(),
                     static_cast<int>(indices_.size()), distances_.data());
    return accepted();
  }

 private:
  int accepted() const {
    std::size_t best = 0;
    for (std::size_t k = 1; k < indices_.size(); ++k) {
      if (distances_[k] < distances_[best] ||
          (distances_[k] == distances_[best] && indices_[k] < indices_[best])) {
        best = k;
      }
    }
    if (indices_.empty() || distances_[best] > parameters_.max_line_distance) return -1;
    for (std::size_t k = 0; k < indices_.size(); ++k) {
      if (k == best || distances_[best] < parameters_.max_distance_ratio * distances_[k]) continue;
      if (!collinear(candidates_.segments[indices_[best]], candidates_.segments[indices_[k]]))
        return -1;
    }
    return indices_[best];
  }

  const LineViews& candidates_;
  const MatchingParameters& parameters_;
  SegmentGrid grid_;
  std::vector<int> indices_;
  std::vector<int> distances_;
};

/// For each left segment the nearest right one (`sign` +1), or for each right one the left one
/// (-1), else -1.
std::vector<int> bestOnSameRows(const LineViews& from, const LineViews& to, int sign,
                                const MatchingParameters& parameters) {
  const SegmentLimits limits(parameters);
  LineSearch search(to, parameters);
  std::vector<int> partners;
  partners.reserve(from.segments.size());
  for (std::size_t i = 0; i < from.segments.size(); ++i) {
    const Segment& a = from.segments[i];
    Eigen::AlignedBox2f box(a.start.cwiseMin(a.end), a.start.cwiseMax(a.end));
    const auto reach = static_cast<float>(parameters.max_disparity_px);
    (sign > 0 ? box.min().x() : box.max().x()) -= sign * reach;
    partners.push_back(search.best(from.descriptors[i], box, [&](const Segment& b) {
      if (!alike(a, b, limits)) return false;
      const float height = std::abs(a.end.y() - a.start.y()) + std::abs(b.end.y() - b.start.y());
      const bool flat = height < 2.0F * static_cast<float>(parameters.max_row_difference_px);
      const bool share_rows =
          flat ? std::abs(a.middle().y() - b.middle().y()) <= parameters.max_row_difference_px
               : overlapRatio(a.start.y(), a.end.y(), b.start.y(), b.end.y()) >= limits.min_overlap;
      const float disparity = sign * (a.middle().x() - b.middle().x());
      const float slack = 0.5F * (a.size + b.size);  // end points are uncertain along the edge
      return share_rows && disparity >= -slack && disparity <= parameters.max_disparity_px + slack;
    }));
  }
  return partners;
}

/// For each segment of `from`, at its predicted position, the nearest descriptor of `to` around it,
/// or -1.
std::vector<int> bestNearExpected(const LineViews& from, const LineViews& to, double radius_px,
                                  const MatchingParameters& parameters) {
  const SegmentLimits limits(parameters);
  LineSearch search(to, parameters);
  const auto radius = static_cast<float>(radius_px);
  const Eigen::Vector2f reach(radius, radius);
  std::vector<int> partners;
  partners.reserve(from.segments.size());
  for (std::size_t i = 0; i < from.segments.size(); ++i) {
    const Segment& a = from.segments[i];
    const Eigen::AlignedBox2f box(a.start.cwiseMin(a.end) - reach, a.start.cwiseMax(a.end) + reach);
    partners.push_back(search.best(from.descriptors[i], box, [&](const Segment& b) {
      return alike(a, b, limits) && distanceToInfiniteLine(a, b.middle()) <= radius &&
             overlapRatio(0.0F, a.size, a.along.dot(b.start - a.start),
                          a.along.dot(b.end - a.start)) >= limits.min_overlap;
    }));
  }
  return partners;
}

LineSegment project(const StereoCamera& camera, const Eigen::Vector3d& start,
                    const Eigen::Vector3d& end, bool left) {
  if (left) return {camera.projectLeft(start).cast<float>(), camera.projectLeft(end).cast<float>()};
  return {camera.projectRight(start).cast<float>(), camera.projectRight(end).cast<float>()};
}

/// The image with a margin, in which segments are visible. Those that reach far beyond it are left
/// out, too.
class ImageArea {
 public:
  ImageArea(const StereoCamera& camera, double margin_px)
      : size_(static_cast<float>(camera.width), static_cast<float>(camera.height)),
        margin_(static_cast<float>(margin_px)) {}

  bool touches(const LineSegment& segment) const {
    const Eigen::Vector2f low = segment.start.cwiseMin(segment.end);
    const Eigen::Vector2f high = segment.start.cwiseMax(segment.end);
    const Eigen::Vector2f margin(margin_, margin_);
    const bool near =
        ((high + margin).array() >= 0.0F).all() && ((low - margin).array() <= size_.array()).all();
    return near && segment.length() <= kMaxBeyond * size_.norm();
  }

 private:
  static constexpr float kMaxBeyond = 2.0F;
  Eigen::Vector2f size_;
  float margin_;
};

}  // namespace

std::vector<IndexPair> matchLinesStereo(const std::vector<LineFeature>& left,
                                        const std::vector<LineFeature>& right,
                                        const MatchingParameters& parameters, ThreadPool* threads) {
  const LineViews left_views = viewsOf(left);
  const LineViews right_views = viewsOf(right);
  std::vector<int> to_right;
  std::vector<int> to_left;
  runBoth(
      threads, [&] { to_right = bestOnSameRows(left_views, right_views, 1, parameters); },
      [&] { to_left = bestOnSameRows(right_views, left_views, -1, parameters); });
  return crossCheck(to_right, to_left);
}

std::optional<ExpectedLine> expectLine(const StereoCamera& camera, const Eigen::Vector3d& start,
                                       const Eigen::Vector3d& end, double margin_px) {
  const double nearest_m = 0.1 * camera.baseline_m;
  if (!(start.z() >= nearest_m && end.z() >= nearest_m)) return std::nullopt;
  ExpectedLine line;
  line.left = project(camera, start, end, true);
  if (!ImageArea(camera, margin_px).touches(line.left)) return std::nullopt;
  line.right = project(camera, start, end, false);
  return line;
}

std::vector<IndexPair> matchExpectedLines(const std::vector<ExpectedLine>& expected,
                                          const StereoFrame& curr, double radius_px,
                                          const MatchingParameters& parameters,
                                          ThreadPool* threads) {
  LineViews expected_left;
  LineViews expected_right;
  for (const ExpectedLine& line : expected) {
    expected_left.add(line.left, line.left_descriptor);
    expected_right.add(line.right, line.right_descriptor);
  }
  LineViews curr_left;
  LineViews curr_right;
  for (const StereoLine& line : curr.lines) {
    const LineFeature& left = curr.features.lines_left[line.left];
    const LineFeature& right = curr.features.lines_right[line.right];
    curr_left.add(left.segment, left.descriptor);
    curr_right.add(right.segment, right.descriptor);
  }

  // r(k-1) -> r(k); the stereo match r(k) -> l(k); then l(k) -> l(k-1).
  std::vector<int> forward;
  std::vector<int> backward;
  runBoth(
      threads,
      [&] { forward = bestNearExpected(expected_right, curr_right, radius_px, parameters); },
      [&] { backward = bestNearExpected(curr_left, expected_left, radius_px, parameters); });
  return crossCheck(forward, backward);
}

std::vector<IndexPair> matchLinesCircular(const StereoFrame& prev, const StereoFrame& curr,
                                          const StereoCamera& camera,
                                          const MotionPrediction& prediction,
                                          const MatchingParameters& parameters,
                                          ThreadPool* threads) {
  std::vector<int> prev_index;
  std::vector<ExpectedLine> expected;
  for (std::size_t i = 0; i < prev.lines.size(); ++i) {
    const StereoLine& line = prev.lines[i];
    if (!line.triangulated) continue;
    const auto predict = [&](const Eigen::Vector3d& p_prev) {
      return prediction.shutter.whenExposed(camera, prediction.T_curr_prev * p_prev);
    };
    std::optional<ExpectedLine> expected_line =
        expectLine(camera, predict(line.triangulated->start_camera),
                   predict(line.triangulated->end_camera), prediction.radius_px);
    if (!expected_line) continue;
    expected_line->left_descriptor = prev.features.lines_left[line.left].descriptor;
    expected_line->right_descriptor = prev.features.lines_right[line.right].descriptor;
    prev_index.push_back(static_cast<int>(i));
    expected.push_back(*expected_line);
  }
  std::vector<IndexPair> pairs =
      matchExpectedLines(expected, curr, prediction.radius_px, parameters, threads);
  for (IndexPair& pair : pairs) pair.first = prev_index[pair.first];
  return pairs;
}

}  // namespace point_line_odometry
