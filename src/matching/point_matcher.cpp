#include <cmath>

#include "matching/descriptor_distance.h"
#include "matching/pixel_grid.h"
#include "point_line_odometry/matching.h"

namespace point_line_odometry {
namespace {

constexpr int kCellPx = 10;

std::vector<Eigen::Vector2f> pixelsOf(const std::vector<PointFeature>& features) {
  std::vector<Eigen::Vector2f> pixels;
  pixels.reserve(features.size());
  for (const PointFeature& feature : features) pixels.push_back(feature.pixel);
  return pixels;
}

Eigen::Vector2f extent(const std::vector<Eigen::Vector2f>& pixels) {
  Eigen::Vector2f high = Eigen::Vector2f::Zero();
  for (const Eigen::Vector2f& pixel : pixels) high = high.cwiseMax(pixel);
  return high;
}

PixelGrid makeGrid(const std::vector<Eigen::Vector2f>& pixels) {
  const Eigen::Vector2f size = extent(pixels);
  PixelGrid grid(static_cast<int>(size.x()) + 1, static_cast<int>(size.y()) + 1, kCellPx);
  grid.fill(pixels);
  return grid;
}

/// Best partner of `from` among `to` within the rectangle low..high, or -1.
int bestWithin(const PointFeature& from, const std::vector<PointFeature>& to, const PixelGrid& grid,
               const Eigen::AlignedBox2f& window, const MatchingParameters& parameters) {
  BestTwo search;
  grid.forEachNear(window.min(), window.max(), [&](int i) {
    if (!window.contains(to[i].pixel) || std::abs(to[i].octave - from.octave) > 1) return;
    search.offer(i, hammingDistance(from.descriptor, to[i].descriptor));
  });
  return search.accepted(parameters.max_point_distance, parameters.max_distance_ratio);
}

/// One leg of the circle between frames: for each point of `from` the best of `to` in a disc round
/// its expected pixel, or -1.
struct TemporalLeg {
  const std::vector<Descriptor>& from;
  const std::vector<Eigen::Vector2f>& expected;
  const std::vector<Descriptor>& to;
  const std::vector<Eigen::Vector2f>& to_pixels;
};

std::vector<int> bestInDiscs(const TemporalLeg& leg, double radius_px,
                             const MatchingParameters& parameters) {
  const PixelGrid grid = makeGrid(leg.to_pixels);
  const auto radius = static_cast<float>(radius_px);
  const Eigen::Vector2f reach(radius, radius);
  std::vector<int> partners(leg.from.size(), -1);
  for (std::size_t i = 0; i < leg.from.size(); ++i) {
    const Eigen::Vector2f& centre = leg.expected[i];
    BestTwo search;
    grid.forEachNear(centre - reach, centre + reach, [&](int k) {
      if ((leg.to_pixels[k] - centre).squaredNorm() > radius * radius) return;
      search.offer(k, hammingDistance(leg.from[i], leg.to[k]));
    });
    partners[i] = search.accepted(parameters.max_point_distance, parameters.max_distance_ratio);
  }
  return partners;
}

/// Pixels and descriptors of stereo points, in both images.
struct StereoPointViews {
  std::vector<Eigen::Vector2f> left_px;
  std::vector<Eigen::Vector2f> right_px;
  std::vector<Descriptor> left;
  std::vector<Descriptor> right;

  void add(const Eigen::Vector2f& pixel_left, const Descriptor& descriptor_left,
           const Eigen::Vector2f& pixel_right, const Descriptor& descriptor_right) {
    left_px.push_back(pixel_left);
    right_px.push_back(pixel_right);
    left.push_back(descriptor_left);
    right.push_back(descriptor_right);
  }
};

}  // namespace

std::vector<IndexPair> matchPointsStereo(const std::vector<PointFeature>& left,
                                         const std::vector<PointFeature>& right,
                                         const MatchingParameters& parameters) {
  const PixelGrid left_grid = makeGrid(pixelsOf(left));
  const PixelGrid right_grid = makeGrid(pixelsOf(right));
  const auto min_disparity = static_cast<float>(parameters.min_disparity_px);
  const auto max_disparity = static_cast<float>(parameters.max_disparity_px);
  const auto rows = static_cast<float>(parameters.max_row_difference_px);

  std::vector<IndexPair> pairs;
  for (std::size_t i = 0; i < left.size(); ++i) {
    const Eigen::Vector2f& pixel = left[i].pixel;
    const Eigen::AlignedBox2f in_right(
        Eigen::Vector2f(pixel.x() - max_disparity, pixel.y() - rows),
        Eigen::Vector2f(pixel.x() - min_disparity, pixel.y() + rows));
    const int partner = bestWithin(left[i], right, right_grid, in_right, parameters);
    if (partner < 0) continue;
    const Eigen::Vector2f& back = right[partner].pixel;
    const Eigen::AlignedBox2f in_left(Eigen::Vector2f(back.x() + min_disparity, back.y() - rows),
                                      Eigen::Vector2f(back.x() + max_disparity, back.y() + rows));
    if (bestWithin(right[partner], left, left_grid, in_left, parameters) != static_cast<int>(i))
      continue;
    pairs.push_back({static_cast<int>(i), partner});
  }
  return pairs;
}

std::vector<IndexPair> matchPointsCircular(const StereoFrame& prev, const StereoFrame& curr,
                                           const StereoCamera& camera,
                                           const MotionPrediction& prediction,
                                           const MatchingParameters& parameters) {
  // Points of k-1 that are expected in the images of frame k, and where.
  const auto margin = static_cast<float>(prediction.radius_px);
  const Eigen::AlignedBox2f view(Eigen::Vector2f(-margin, -margin),
                                 Eigen::Vector2f(static_cast<float>(camera.width) + margin,
                                                 static_cast<float>(camera.height) + margin));
  std::vector<int> prev_index;
  StereoPointViews expected;
  for (std::size_t i = 0; i < prev.points.size(); ++i) {
    const StereoPoint& point = prev.points[i];
    const Eigen::Vector3d p_curr = prediction.T_curr_prev * point.triangulated.p_camera;
    if (p_curr.z() < 0.1 * camera.baseline_m) continue;
    const Eigen::Vector2f left_px = camera.projectLeft(p_curr).cast<float>();
    if (!view.contains(left_px)) continue;
    prev_index.push_back(static_cast<int>(i));
    expected.add(left_px, prev.features.points_left[point.left].descriptor,
                 camera.projectRight(p_curr).cast<float>(),
                 prev.features.points_right[point.right].descriptor);
  }
  StereoPointViews seen;
  for (const StereoPoint& point : curr.points) {
    const PointFeature& left = curr.features.points_left[point.left];
    const PointFeature& right = curr.features.points_right[point.right];
    seen.add(left.pixel, left.descriptor, right.pixel, right.descriptor);
  }

  // r(k-1) -> r(k); the stereo pair leads on to l(k); then l(k) -> l(k-1).
  const std::vector<int> forward =
      bestInDiscs({expected.right, expected.right_px, seen.right, seen.right_px},
                  prediction.radius_px, parameters);
  const std::vector<int> backward = bestInDiscs(
      {seen.left, seen.left_px, expected.left, expected.left_px}, prediction.radius_px, parameters);
  std::vector<IndexPair> pairs;
  for (std::size_t i = 0; i < forward.size(); ++i) {
    if (forward[i] >= 0 && backward[forward[i]] == static_cast<int>(i)) {
      pairs.push_back({prev_index[i], forward[i]});
    }
  }
  return pairs;
}

}  // namespace point_line_odometry
