#include <algorithm>
#include <cmath>

#include "matching/descriptor_distance.h"
#include "matching/segment_grid.h"
#include "point_line_odometry/matching.h"

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

/// Direction and length: the appearance-geometry constraint that both kinds of search share.
bool alike(const LineSegment& a, const LineSegment& b, const SegmentLimits& limits) {
  if (a.direction().dot(b.direction()) < limits.min_cosine) return false;
  const float la = a.length();
  const float lb = b.length();
  return std::min(la, lb) >= limits.min_length_ratio * std::max(la, lb);
}

float distanceToInfiniteLine(const LineSegment& line, const Eigen::Vector2f& p) {
  const Eigen::Vector2f d = line.direction();
  const Eigen::Vector2f q = p - line.start;
  return std::abs(d.x() * q.y() - d.y() * q.x());
}

bool collinear(const LineSegment& a, const LineSegment& b) {
  return distanceToInfiniteLine(a, b.start) < kCollinearPx &&
         distanceToInfiniteLine(a, b.end) < kCollinearPx;
}

/// Best and second-best descriptor; a piece of the same edge as the best is not a rival.
class LineSearch {
 public:
  explicit LineSearch(const std::vector<LineSegment>& candidates) : candidates_(candidates) {}

  void offer(int index, int distance) { offers_.push_back({index, distance}); }

  int accepted(const MatchingParameters& parameters) const {
    const auto best =
        std::min_element(offers_.begin(), offers_.end(), [](const Offer& a, const Offer& b) {
          return a.distance != b.distance ? a.distance < b.distance : a.index < b.index;
        });
    if (best == offers_.end() || best->distance > parameters.max_line_distance) return -1;
    for (const Offer& other : offers_) {
      if (other.index == best->index ||
          best->distance < parameters.max_distance_ratio * other.distance)
        continue;
      if (!collinear(candidates_[best->index], candidates_[other.index])) return -1;
    }
    return best->index;
  }

 private:
  struct Offer {
    int index;
    int distance;
  };
  const std::vector<LineSegment>& candidates_;
  std::vector<Offer> offers_;
};

struct LineViews {
  std::vector<LineSegment> segments;
  std::vector<Descriptor> descriptors;

  void add(const LineSegment& segment, const Descriptor& descriptor) {
    segments.push_back(segment);
    descriptors.push_back(descriptor);
  }
};

LineViews viewsOf(const std::vector<LineFeature>& features) {
  LineViews views;
  for (const LineFeature& feature : features) views.add(feature.segment, feature.descriptor);
  return views;
}

/// Disparity range in which a left and a right segment may pair; `sign` is +1 from left to right,
/// -1 back.
std::vector<int> bestOnSameRows(const LineViews& from, const LineViews& to, int sign,
                                const MatchingParameters& parameters) {
  const SegmentLimits limits(parameters);
  const SegmentGrid grid(to.segments);
  std::vector<int> partners(from.segments.size(), -1);
  for (std::size_t i = 0; i < from.segments.size(); ++i) {
    const LineSegment& a = from.segments[i];
    Eigen::AlignedBox2f box(a.start.cwiseMin(a.end), a.start.cwiseMax(a.end));
    const auto reach = static_cast<float>(parameters.max_disparity_px);
    (sign > 0 ? box.min().x() : box.max().x()) -= sign * reach;
    LineSearch search(to.segments);
    grid.forEachNear(box, [&](int k) {
      const LineSegment& b = to.segments[k];
      if (!alike(a, b, limits)) return;
      const float height = std::abs(a.end.y() - a.start.y()) + std::abs(b.end.y() - b.start.y());
      const bool flat = height < 2.0F * static_cast<float>(parameters.max_row_difference_px);
      const bool share_rows =
          flat ? std::abs(a.middle().y() - b.middle().y()) <= parameters.max_row_difference_px
               : overlapRatio(a.start.y(), a.end.y(), b.start.y(), b.end.y()) >= limits.min_overlap;
      const float disparity = sign * (a.middle().x() - b.middle().x());
      const float slack = 0.5F * (a.length() + b.length());  // end points slide along the edge
      if (!share_rows || disparity < -slack || disparity > parameters.max_disparity_px + slack)
        return;
      search.offer(k, hammingDistance(from.descriptors[i], to.descriptors[k]));
    });
    partners[i] = search.accepted(parameters);
  }
  return partners;
}

/// For each segment of `from` the best of `to` that lies near its expected place, or -1.
std::vector<int> bestNearExpected(const std::vector<Descriptor>& from,
                                  const std::vector<LineSegment>& expected, const LineViews& to,
                                  double radius_px, const MatchingParameters& parameters) {
  const SegmentLimits limits(parameters);
  const SegmentGrid grid(to.segments);
  const auto radius = static_cast<float>(radius_px);
  std::vector<int> partners(from.size(), -1);
  for (std::size_t i = 0; i < from.size(); ++i) {
    const LineSegment& a = expected[i];
    const Eigen::Vector2f reach(radius, radius);
    const Eigen::Vector2f along = a.direction();
    LineSearch search(to.segments);
    grid.forEachNear({a.start.cwiseMin(a.end) - reach, a.start.cwiseMax(a.end) + reach},
                     [&](int k) {
                       const LineSegment& b = to.segments[k];
                       if (!alike(a, b, limits) || distanceToInfiniteLine(a, b.middle()) > radius)
                         return;
                       if (overlapRatio(0.0F, a.length(), along.dot(b.start - a.start),
                                        along.dot(b.end - a.start)) < limits.min_overlap) {
                         return;
                       }
                       search.offer(k, hammingDistance(from[i], to.descriptors[k]));
                     });
    partners[i] = search.accepted(parameters);
  }
  return partners;
}

LineSegment project(const StereoCamera& camera, const Eigen::Vector3d& start,
                    const Eigen::Vector3d& end, bool left) {
  if (left) return {camera.projectLeft(start).cast<float>(), camera.projectLeft(end).cast<float>()};
  return {camera.projectRight(start).cast<float>(), camera.projectRight(end).cast<float>()};
}

/// Where segments can be seen: the image and a margin. Those that reach far beyond it are left out,
/// too.
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
                                        const MatchingParameters& parameters) {
  const LineViews left_views = viewsOf(left);
  const LineViews right_views = viewsOf(right);
  const std::vector<int> to_right = bestOnSameRows(left_views, right_views, 1, parameters);
  const std::vector<int> to_left = bestOnSameRows(right_views, left_views, -1, parameters);
  std::vector<IndexPair> pairs;
  for (std::size_t i = 0; i < to_right.size(); ++i) {
    if (to_right[i] >= 0 && to_left[to_right[i]] == static_cast<int>(i)) {
      pairs.push_back({static_cast<int>(i), to_right[i]});
    }
  }
  return pairs;
}

std::vector<IndexPair> matchLinesCircular(const StereoFrame& prev, const StereoFrame& curr,
                                          const StereoCamera& camera,
                                          const MotionPrediction& prediction,
                                          const MatchingParameters& parameters) {
  // Lines of k-1 that can be placed in the images of frame k, and where.
  std::vector<int> prev_index;
  LineViews expected_left;
  LineViews expected_right;
  const double nearest_m = 0.1 * camera.baseline_m;
  const ImageArea area(camera, prediction.radius_px);
  for (std::size_t i = 0; i < prev.lines.size(); ++i) {
    const StereoLine& line = prev.lines[i];
    if (!line.triangulated) continue;
    const Eigen::Vector3d start = prediction.T_curr_prev * line.triangulated->start_camera;
    const Eigen::Vector3d end = prediction.T_curr_prev * line.triangulated->end_camera;
    if (start.z() < nearest_m || end.z() < nearest_m) continue;
    if (!area.touches(project(camera, start, end, true))) continue;
    prev_index.push_back(static_cast<int>(i));
    expected_left.add(project(camera, start, end, true),
                      prev.features.lines_left[line.left].descriptor);
    expected_right.add(project(camera, start, end, false),
                       prev.features.lines_right[line.right].descriptor);
  }
  LineViews curr_left;
  LineViews curr_right;
  for (const StereoLine& line : curr.lines) {
    const LineFeature& left = curr.features.lines_left[line.left];
    const LineFeature& right = curr.features.lines_right[line.right];
    curr_left.add(left.segment, left.descriptor);
    curr_right.add(right.segment, right.descriptor);
  }

  // r(k-1) -> r(k); the stereo pair leads on to l(k); then l(k) -> l(k-1).
  const std::vector<int> forward =
      bestNearExpected(expected_right.descriptors, expected_right.segments, curr_right,
                       prediction.radius_px, parameters);
  const std::vector<int> backward = bestNearExpected(
      curr_left.descriptors, curr_left.segments, expected_left, prediction.radius_px, parameters);
  std::vector<IndexPair> pairs;
  for (std::size_t i = 0; i < forward.size(); ++i) {
    if (forward[i] >= 0 && backward[forward[i]] == static_cast<int>(i))
      pairs.push_back({prev_index[i], forward[i]});
  }
  return pairs;
}

StereoMatches matchStereo(const DetectedFeatures& features, const MatchingParameters& parameters) {
  return {matchPointsStereo(features.points_left, features.points_right, parameters),
          matchLinesStereo(features.lines_left, features.lines_right, parameters)};
}

CircularMatches matchCircular(const StereoFrame& prev, const StereoFrame& curr,
                              const StereoCamera& camera, const MotionPrediction& prediction,
                              const MatchingParameters& parameters) {
  return {matchPointsCircular(prev, curr, camera, prediction, parameters),
          matchLinesCircular(prev, curr, camera, prediction, parameters)};
}

}  // namespace point_line_odometry
