#include "map/map_search.h"

#include <algorithm>
#include <optional>

#include "features/edge_aligner.h"
#include "matching/expected_features.h"
#include "matching/index_pair.h"
#include "matching/line_matcher.h"
#include "matching/patch_warp.h"
#include "matching/point_matcher.h"
#include "motion/observations.h"

namespace point_line_odometry {
namespace {

/// A point of the map projected into the images.
struct View {
  std::size_t index;  // of the point
  Eigen::Vector2f left_px;
  Eigen::Vector2f right_px;
  StereoWarp warp;
  bool align = false;  // the pixels are accurate enough for the patch's alignment
};

/// Nothing if an image does not show the point, or it is masked there.
std::optional<View> viewOf(const std::vector<MapPoint>& points, std::size_t index,
                           const FrameContext& context, const Eigen::Isometry3d& T_camera_map) {
  const MapPoint& point = points[index];
  const StereoCamera& camera = context.camera;
  const Eigen::Vector3d p = T_camera_map * point.estimate.value;
  if (!(p.z() > camera.baseline_m)) return std::nullopt;
  const Eigen::Vector3d p_exposed = context.shutter.whenExposed(camera, p);
  const Eigen::Vector2d left = camera.projectLeft(p_exposed);
  const Eigen::Vector2d right = camera.projectRight(p_exposed);
  constexpr int kMargin = PatchAligner::kSide / 2 + 2;
  const auto inside = [&](const Eigen::Vector2d& pixel) {
    return pixel.x() >= kMargin && pixel.y() >= kMargin && pixel.x() < camera.width - kMargin &&
           pixel.y() < camera.height - kMargin;
  };
  if (!inside(left) || !inside(right)) return std::nullopt;
  const int octave = point.octave;
  if (octave >= static_cast<int>(context.left.levels.size())) return std::nullopt;
  if (!context.masks.left.allowsPatch(context.left.toLevel(left.cast<float>(), octave), octave) ||
      !context.masks.right.allowsPatch(context.right.toLevel(right.cast<float>(), octave), octave))
    return std::nullopt;
  const auto warp = stereoPatchWarp(camera, p, T_camera_map.linear() * point.patch_axes);
  if (!warp) return std::nullopt;
  return View{index, left.cast<float>(), right.cast<float>(), *warp, point.statistics.missed == 0};
}

/// The points in view, in the order of the map.
std::vector<View> viewsOf(const std::vector<MapPoint>& points, const FrameContext& context,
                          const Eigen::Isometry3d& T_camera_map, ThreadPool* threads) {
  std::vector<std::vector<View>> parts(static_cast<std::size_t>(numParts(threads)));
  runParts(threads, points.size(), [&](int part, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::optional<View> view = viewOf(points, i, context, T_camera_map);
      if (view) parts[static_cast<std::size_t>(part)].push_back(*view);
    }
  });
  std::vector<View> views;
  for (const std::vector<View>& part : parts) views.insert(views.end(), part.begin(), part.end());
  return views;
}

StereoPatch patchOf(const MapPoint& point, const StereoWarp& warp) {
  const cv::Mat patch(MapPoint::kPatchSide, MapPoint::kPatchSide, CV_8UC1,
                      const_cast<std::uint8_t*>(point.patch.data()));  // only read
  return StereoPatch(patch, Eigen::Vector2f(MapPoint::kHalfPatch, MapPoint::kHalfPatch), warp);
}

/// Aligns the patches of the points whose pixels are accurate enough, and notes which are in view.
void alignPatches(const std::vector<MapPoint>& points, const std::vector<View>& views,
                  const FrameContext& context, ThreadPool* threads,
                  LandmarkMatches* landmark_matches) {
  std::vector<std::optional<PointObservation>> found(views.size());
  runParts(threads, views.size(), [&](int, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const View& view = views[i];
      if (!view.align) continue;
      const MapPoint& point = points[view.index];
      found[i] =
          alignPoint(patchOf(point, view.warp), point.octave, view.left_px, view.right_px, context);
    }
  });
  landmark_matches->point_in_view.assign(points.size(), false);
  for (std::size_t i = 0; i < views.size(); ++i) {
    landmark_matches->point_in_view[views[i].index] = true;
    if (found[i]) landmark_matches->points.push_back({static_cast<int>(views[i].index), *found[i]});
  }
}

/// A line projected into the images; nothing if it is not in view.
std::optional<ExpectedLine> viewOf(const MapLine& line, const FrameContext& context,
                                   const Eigen::Isometry3d& T_camera_map) {
  const LineEstimate::Value& ends = line.estimate.value;
  const StereoCamera& camera = context.camera;
  return expectLine(camera, context.shutter.whenExposed(camera, T_camera_map * ends.head<3>()),
                    context.shutter.whenExposed(camera, T_camera_map * ends.tail<3>()), 0.0);
}

bool isHidden(const ExpectedLine& segments, const StereoMasks& masks) {
  return masks.left.hides(segments.left) || masks.right.hides(segments.right);
}

}  // namespace

void findPoints(const std::vector<MapPoint>& points, const Eigen::Isometry3d& T_camera_map,
                const StereoFrame& frame, const FrameContext& context, ThreadPool* threads,
                LandmarkMatches* landmark_matches) {
  std::vector<View> views = viewsOf(points, context, T_camera_map, threads);
  std::vector<ExpectedPoint> expected;
  std::vector<View*> expected_views;
  for (View& view : views) {
    if (view.align) continue;
    const MapPoint& point = points[view.index];
    expected_views.push_back(&view);
    expected.push_back({view.left_px, view.right_px, point.left, point.right});
  }
  for (const IndexPair& pair :
       matchExpectedPoints(expected, frame, context.parameters.local_map.search_radius_px,
                           context.parameters.matching, threads)) {
    const StereoPoint& seen = frame.points[static_cast<std::size_t>(pair.second)];
    View* view = expected_views[static_cast<std::size_t>(pair.first)];
    view->left_px = frame.features.points_left[seen.left].pixel;
    view->right_px = frame.features.points_right[seen.right].pixel;
    view->align = true;
  }
  alignPatches(points, views, context, threads, landmark_matches);
}

void alignPoints(const std::vector<MapPoint>& points, const Eigen::Isometry3d& T_camera_map,
                 const FrameContext& context, ThreadPool* threads,
                 LandmarkMatches* landmark_matches) {
  std::vector<View> views = viewsOf(points, context, T_camera_map, threads);
  const auto missed = [](const View& view) { return !view.align; };
  views.erase(std::remove_if(views.begin(), views.end(), missed), views.end());
  alignPatches(points, views, context, threads, landmark_matches);
}

void findLines(const std::vector<MapLine>& lines, const Eigen::Isometry3d& T_camera_map,
               const StereoFrame& frame, const FrameContext& context, ThreadPool* threads,
               LandmarkMatches* landmark_matches) {
  std::vector<ExpectedLine> expected;
  std::vector<int> expected_index;
  landmark_matches->line_in_view.resize(lines.size());
  for (std::size_t i = 0; i < lines.size(); ++i) {
    std::optional<ExpectedLine> segments = viewOf(lines[i], context, T_camera_map);
    landmark_matches->line_in_view[i] = segments && !isHidden(*segments, context.masks);
    if (!segments) continue;
    segments->left_descriptor = lines[i].left;
    segments->right_descriptor = lines[i].right;
    expected_index.push_back(static_cast<int>(i));
    expected.push_back(*segments);
  }
  for (const IndexPair& pair :
       matchExpectedLines(expected, frame, context.parameters.local_map.search_radius_px,
                          context.parameters.matching, threads)) {
    landmark_matches->lines.push_back(
        {expected_index[static_cast<std::size_t>(pair.first)], pair.second,
         lineObservation(frame.features, frame.lines[static_cast<std::size_t>(pair.second)],
                         context)});
  }
}

void alignLines(const std::vector<MapLine>& lines, const Eigen::Isometry3d& T_camera_map,
                const FrameContext& context, ThreadPool* threads,
                LandmarkMatches* landmark_matches) {
  const LineParameters& parameters = context.parameters.lines;
  std::vector<std::uint8_t> in_view(lines.size());  // not bool: those of a byte share it
  std::vector<std::optional<LineObservation>> found(lines.size());
  runParts(threads, lines.size(), [&](int, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (lines[i].statistics.missed > 0) continue;
      const std::optional<ExpectedLine> segments = viewOf(lines[i], context, T_camera_map);
      in_view[i] = segments && !isHidden(*segments, context.masks);
      if (!in_view[i]) continue;
      const auto left =
          alignEdge(context.images.left, context.masks.left, segments->left, parameters);
      if (!left) continue;
      const auto right =
          alignEdge(context.images.right, context.masks.right, segments->right, parameters);
      if (right) found[i] = lineObservation(*left, *right, 1.0, context);
    }
  });
  landmark_matches->line_in_view.assign(in_view.begin(), in_view.end());
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (found[i]) landmark_matches->lines.push_back({static_cast<int>(i), -1, *found[i]});
  }
}

}  // namespace point_line_odometry
