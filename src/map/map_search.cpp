#include "map/map_search.h"

#include <optional>

#include "matching/patch_warp.h"

namespace point_line_odometry {
namespace {

constexpr int kHalfPatch = MapPoint::kPatchSide / 2;

/// A point of the map as the camera should see it.
struct View {
  Eigen::Vector2f left_px;
  Eigen::Vector2f right_px;
  StereoWarp warp;    // pixels of the patch per pixel of the images
  bool look = false;  // the places are near enough for the patch to be aligned
};

std::optional<View> viewOf(const MapPoint& point, const StereoCamera& camera,
                           const Eigen::Isometry3d& T_camera_map) {
  const Eigen::Vector3d p = T_camera_map * point.place.value;
  if (!(p.z() > camera.baseline_m)) return std::nullopt;
  const Eigen::Vector2d left = camera.projectLeft(p);
  const Eigen::Vector2d right = camera.projectRight(p);
  constexpr int kMargin = PatchAligner::kSide / 2 + 2;
  const auto inside = [&](const Eigen::Vector2d& pixel) {
    return pixel.x() >= kMargin && pixel.y() >= kMargin && pixel.x() < camera.width - kMargin &&
           pixel.y() < camera.height - kMargin;
  };
  if (!inside(left) || !inside(right)) return std::nullopt;
  const auto warp = stereoPatchWarp(camera, p, T_camera_map.linear() * point.patch_axes);
  if (!warp) return std::nullopt;
  return View{left.cast<float>(), right.cast<float>(), *warp, false};
}

StereoPatch patchOf(const MapPoint& point, const StereoWarp& warp) {
  const cv::Mat patch(MapPoint::kPatchSide, MapPoint::kPatchSide, CV_8UC1,
                      const_cast<std::uint8_t*>(point.patch.data()));  // only read
  return StereoPatch(patch, Eigen::Vector2f(kHalfPatch, kHalfPatch), warp);
}

}  // namespace

void findPoints(const std::vector<MapPoint>& points, const Eigen::Isometry3d& T_camera_map,
                const StereoFrame& frame, const FrameContext& context, ThreadPool* threads,
                MapSights* sights) {
  std::vector<std::optional<View>> views(points.size());
  std::vector<ExpectedPoint> expected;
  std::vector<std::size_t> expected_index;
  for (std::size_t i = 0; i < points.size(); ++i) {
    views[i] = viewOf(points[i], context.camera, T_camera_map);
    if (!views[i]) continue;
    views[i]->look = points[i].sightings.missed == 0;
    if (views[i]->look) continue;
    expected_index.push_back(i);
    expected.push_back({views[i]->left_px, views[i]->right_px, points[i].left, points[i].right});
  }
  for (const IndexPair& pair :
       matchExpectedPoints(expected, frame, context.parameters.local_map.search_radius_px,
                           context.parameters.matching)) {
    const StereoPoint& seen = frame.points[static_cast<std::size_t>(pair.second)];
    View& view = *views[expected_index[static_cast<std::size_t>(pair.first)]];
    view.left_px = frame.features.points_left[seen.left].pixel;
    view.right_px = frame.features.points_right[seen.right].pixel;
    view.look = true;
  }

  std::vector<std::optional<PointSight>> found(points.size());
  threads->runParts(points.size(), [&](int, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (!views[i] || !views[i]->look) continue;
      found[i] = alignPoint(patchOf(points[i], views[i]->warp), points[i].octave, views[i]->left_px,
                            views[i]->right_px, context);
    }
  });
  sights->point_in_view.resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    sights->point_in_view[i] = views[i].has_value();
    if (found[i]) sights->points.push_back({static_cast<int>(i), *found[i]});
  }
}

void findLines(const std::vector<MapLine>& lines, const Eigen::Isometry3d& T_camera_map,
               const StereoFrame& frame, const FrameContext& context, MapSights* sights) {
  std::vector<ExpectedLine> expected;
  std::vector<int> expected_index;
  sights->line_in_view.resize(lines.size());
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const LineBelief::Value& ends = lines[i].place.value;
    std::optional<ExpectedLine> segments = expectLine(context.camera, T_camera_map * ends.head<3>(),
                                                      T_camera_map * ends.tail<3>(), 0.0);
    sights->line_in_view[i] = segments.has_value();
    if (!segments) continue;
    segments->left_descriptor = lines[i].left;
    segments->right_descriptor = lines[i].right;
    expected_index.push_back(static_cast<int>(i));
    expected.push_back(*segments);
  }
  for (const IndexPair& pair :
       matchExpectedLines(expected, frame, context.parameters.local_map.search_radius_px,
                          context.parameters.matching)) {
    sights->lines.push_back(
        {expected_index[static_cast<std::size_t>(pair.first)], pair.second,
         lineSight(frame.features, frame.lines[static_cast<std::size_t>(pair.second)], context)});
  }
}

}  // namespace point_line_odometry
