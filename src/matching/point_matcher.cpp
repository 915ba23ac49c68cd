#include "matching/point_matcher.h"

#include <cmath>

#include "matching/cross_check.h"
#include "matching/point_grid.h"

namespace point_line_odometry {
namespace {

/// Pixels and descriptors of points.
struct PointViews {
  std::vector<Eigen::Vector2f> pixels;
  std::vector<Descriptor> descriptors;

  void reserve(std::size_t size) {
    pixels.reserve(size);
    descriptors.reserve(size);
  }
  void add(const Eigen::Vector2f& pixel, const Descriptor& descriptor) {
    pixels.push_back(pixel);
    descriptors.push_back(descriptor);
  }
};

PointViews viewsOf(const std::vector<Keypoint>& features) {
  PointViews views;
  views.reserve(features.size());
  for (const Keypoint& feature : features) views.add(feature.pixel, feature.descriptor);
  return views;
}

/// For stereo matching: windows are a few rows high.
PointGrid emptyRowGrid() { return {32, 4}; }

PointGrid rowGrid(const PointViews& points) {
  PointGrid grid = emptyRowGrid();
  grid.fill(points.pixels, points.descriptors);
  return grid;
}

/// One match of the circle between frames: for each point of `from`, at its predicted pixel, the
/// nearest descriptor of `to` within the search radius that passes the ratio test, or -1.
std::vector<int> bestInRadius(const PointViews& from, const PointViews& to, double radius_px,
                              const MatchingParameters& parameters) {
  PointGrid grid(16, 16);
  grid.fill(to.pixels, to.descriptors);
  const auto radius = static_cast<float>(radius_px);
  const Eigen::Vector2f reach(radius, radius);
  std::vector<int> partners(from.pixels.size(), -1);
  for (std::size_t i = 0; i < from.pixels.size(); ++i) {
    const Eigen::Vector2f& centre = from.pixels[i];
    const TwoNearest best = grid.nearest(from.descriptors[i], {centre - reach, centre + reach},
                                         [&](int, const Eigen::Vector2f& pixel) {
                                           return (pixel - centre).squaredNorm() <= radius * radius;
                                         });
    partners[i] = best.accepted(parameters.max_point_distance, parameters.max_distance_ratio);
  }
  return partners;
}

/// Stereo points, by image.
struct StereoPointViews {
  PointViews left;
  PointViews right;

  void reserve(std::size_t size) {
    left.reserve(size);
    right.reserve(size);
  }
};

/// Stereo pairs of points of one frame.
class StereoPointSearch {
 public:
  StereoPointSearch(const std::vector<Keypoint>& left, const std::vector<Keypoint>& right,
                    const MatchingParameters& parameters, ThreadPool* threads)
      : left_(left), right_(right), parameters_(parameters) {
    runBoth(
        threads, [&] { left_grid_ = rowGrid(viewsOf(left)); },
        [&] { right_grid_ = rowGrid(viewsOf(right)); });
  }

  /// Appends the pairs of the left points begin ... end - 1.
  void match(std::size_t begin, std::size_t end, std::vector<IndexPair>* pairs) const {
    for (std::size_t i = begin; i < end; ++i) {
      const int partner = best(left_[i], right_, right_grid_, true);
      if (partner < 0) continue;
      if (best(right_[partner], left_, left_grid_, false) != static_cast<int>(i)) continue;
      pairs->push_back({static_cast<int>(i), partner});
    }
  }

 private:
  int best(const Keypoint& from, const std::vector<Keypoint>& to, const PointGrid& grid,
           bool to_right) const {
    const auto nearest = static_cast<float>(parameters_.max_disparity_px);
    const auto rows = static_cast<float>(parameters_.max_row_difference_px);
    // Down to -1, as points at infinity have a rounded disparity of 1, 0 or -1: without their
    // correct match they would be matched with a similar point.
    constexpr float farthest = -1.0F;
    const Eigen::Vector2f& p = from.pixel;
    const float low = to_right ? p.x() - nearest : p.x() + farthest;
    const float high = to_right ? p.x() - farthest : p.x() + nearest;
    const Eigen::AlignedBox2f window(Eigen::Vector2f(low, p.y() - rows),
                                     Eigen::Vector2f(high, p.y() + rows));
    return grid
        .nearest(from.descriptor, window,
                 [&](int i, const Eigen::Vector2f&) {
                   return std::abs(to[i].octave - from.octave) <= 1;
                 })
        .accepted(parameters_.max_point_distance, parameters_.max_distance_ratio);
  }

  const std::vector<Keypoint>& left_;
  const std::vector<Keypoint>& right_;
  const MatchingParameters& parameters_;
  PointGrid left_grid_ = emptyRowGrid();
  PointGrid right_grid_ = emptyRowGrid();
};

}  // namespace

std::vector<IndexPair> matchPointsStereo(const std::vector<Keypoint>& left,
                                         const std::vector<Keypoint>& right,
                                         const MatchingParameters& parameters,
                                         ThreadPool* threads) {
  const StereoPointSearch search(left, right, parameters, threads);
  std::vector<std::vector<IndexPair>> parts(static_cast<std::size_t>(threads->numParts()));
  threads->runParts(left.size(), [&](int part, std::size_t begin, std::size_t end) {
    search.match(begin, end, &parts[static_cast<std::size_t>(part)]);
  });
  std::vector<IndexPair> pairs;
  for (const std::vector<IndexPair>& part : parts)
    pairs.insert(pairs.end(), part.begin(), part.end());
  return pairs;
}

std::vector<IndexPair> matchExpectedPoints(const std::vector<ExpectedPoint>& expected,
                                           const StereoFrame& curr, double radius_px,
                                           const MatchingParameters& parameters,
                                           ThreadPool* threads) {
  StereoPointViews from;
  from.reserve(expected.size());
  for (const ExpectedPoint& point : expected) {
    from.left.add(point.left_px, point.left_descriptor);
    from.right.add(point.right_px, point.right_descriptor);
  }
  StereoPointViews seen;
  seen.reserve(curr.points.size());
  for (const StereoPoint& point : curr.points) {
    const Keypoint& left = curr.features.points_left[point.left];
    const Keypoint& right = curr.features.points_right[point.right];
    seen.left.add(left.pixel, left.descriptor);
    seen.right.add(right.pixel, right.descriptor);
  }

  // r(k-1) -> r(k); the stereo match r(k) -> l(k); then l(k) -> l(k-1).
  std::vector<int> forward;
  std::vector<int> backward;
  runBoth(
      threads, [&] { forward = bestInRadius(from.right, seen.right, radius_px, parameters); },
      [&] { backward = bestInRadius(seen.left, from.left, radius_px, parameters); });
  return crossCheck(forward, backward);
}

std::vector<IndexPair> matchPointsCircular(const StereoFrame& prev, const StereoFrame& curr,
                                           const StereoCamera& camera,
                                           const MotionPrediction& prediction,
                                           const MatchingParameters& parameters,
                                           ThreadPool* threads) {
  // Points of k-1 predicted in the images of frame k.
  const auto margin = static_cast<float>(prediction.radius_px);
  const Eigen::AlignedBox2f view(Eigen::Vector2f(-margin, -margin),
                                 Eigen::Vector2f(static_cast<float>(camera.width) + margin,
                                                 static_cast<float>(camera.height) + margin));
  std::vector<int> prev_index;
  std::vector<ExpectedPoint> expected;
  expected.reserve(prev.points.size());
  for (std::size_t i = 0; i < prev.points.size(); ++i) {
    const StereoPoint& point = prev.points[i];
    const Eigen::Vector3d p_curr = prediction.shutter.whenExposed(
        camera, prediction.T_curr_prev * point.triangulated.p_camera);
    if (p_curr.z() < 0.1 * camera.baseline_m) continue;
    const Eigen::Vector2f left_px = camera.projectLeft(p_curr).cast<float>();
    if (!view.contains(left_px)) continue;
    prev_index.push_back(static_cast<int>(i));
    expected.push_back({left_px, camera.projectRight(p_curr).cast<float>(),
                        prev.features.points_left[point.left].descriptor,
                        prev.features.points_right[point.right].descriptor});
  }
  std::vector<IndexPair> pairs =
      matchExpectedPoints(expected, curr, prediction.radius_px, parameters, threads);
  for (IndexPair& pair : pairs) pair.first = prev_index[pair.first];
  return pairs;
}

}  // namespace point_line_odometry
