#include "matching/correlation_matcher.h"

#include <algorithm>
#include <cmath>

#include "matching/correlation_patch.h"

namespace point_line_odometry {
namespace {

using Eigen::AlignedBox2f;
using Eigen::Vector2f;

// In pixels of the level.
constexpr float kMaxDisparityChange = 2.0F;  // from the predicted one
constexpr float kMaxCrossCheckError = 1.5F;

std::optional<Vector2f> findStereo(const Keypoint& keypoint, const ImagePyramid& left_image,
                                   const ImagePyramid& right_image, const StereoMasks& masks,
                                   const MatchingParameters& parameters) {
  const auto level = static_cast<std::size_t>(keypoint.octave);
  const cv::Mat& left = left_image.levels[level];
  const cv::Mat& right = right_image.levels[level];
  const Vector2f pixel = left_image.toLevel(keypoint.pixel, keypoint.octave);
  const float range =
      static_cast<float>(parameters.max_disparity_px) / left_image.ratio(keypoint.octave).x();
  const Vector2f lowest(pixel.x() - range, pixel.y() - 1.0F);
  const Vector2f highest(pixel.x() + 1.0F, pixel.y() + 1.0F);
  const auto found = CorrelationPatch(left, pixel).find(right, AlignedBox2f(lowest, highest));
  if (!found || !masks.right.allowsPatch(*found, keypoint.octave)) return std::nullopt;
  const auto back = CorrelationPatch(right, *found)
                        .find(left, AlignedBox2f(Vector2f(found->x() - 1.0F, found->y() - 1.0F),
                                                 Vector2f(found->x() + range, found->y() + 1.0F)));
  if (!back || (*back - pixel).norm() > kMaxCrossCheckError) return std::nullopt;
  return right_image.fromLevel(*found, keypoint.octave);
}

AlignedBox2f around(const Vector2f& centre, const Vector2f& reach) {
  return {centre - reach, centre + reach};
}

std::optional<TrackedPoint> track(const StereoFrame& previous, int index,
                                  const ImagePyramid& left_image, const ImagePyramid& right_image,
                                  const StereoMasks& masks, const StereoCamera& camera,
                                  const CorrelationSearch& search) {
  const StereoPoint& point = previous.points[static_cast<std::size_t>(index)];
  const Keypoint& keypoint = previous.features.points_left[point.left];
  const int octave = keypoint.octave;
  const auto level = static_cast<std::size_t>(octave);
  const MotionPrediction& prediction = search.prediction;
  const Eigen::Vector3d p =
      prediction.shutter.whenExposed(camera, prediction.T_curr_prev * point.triangulated.p_camera);
  if (!(p.z() > camera.baseline_m)) return std::nullopt;
  const CorrelationPatch patch(previous.left_image.levels[level],
                               previous.left_image.toLevel(keypoint.pixel, octave));
  const float radius =
      std::min(static_cast<float>(prediction.radius_px) / left_image.ratio(octave).x(),
               search.max_level_radius);
  const Vector2f expected_left = left_image.toLevel(camera.projectLeft(p).cast<float>(), octave);
  const auto left = patch.find(left_image.levels[level], around(expected_left, {radius, radius}));
  if (!left || !masks.left.allowsPatch(*left, octave)) return std::nullopt;
  // In the same row, where the right image alone finds it, it must have the predicted disparity.
  const Vector2f expected_right = right_image.toLevel(camera.projectRight(p).cast<float>(), octave);
  const Vector2f same_row(expected_right.x() + left->x() - expected_left.x(), left->y());
  const auto right = patch.find(right_image.levels[level], around(same_row, {radius, 1.0F}));
  if (!right || std::abs(right->x() - same_row.x()) > kMaxDisparityChange) return std::nullopt;
  if (!masks.right.allowsPatch(*right, octave)) return std::nullopt;
  return TrackedPoint{index, left_image.fromLevel(*left, octave),
                      right_image.fromLevel(*right, octave)};
}

}  // namespace

std::vector<std::optional<Vector2f>> matchStereoByCorrelation(const std::vector<Keypoint>& left,
                                                              const ImagePyramid& left_image,
                                                              const ImagePyramid& right_image,
                                                              const StereoMasks& masks,
                                                              const MatchingParameters& parameters,
                                                              ThreadPool* threads) {
  std::vector<std::optional<Vector2f>> partners(left.size());
  threads->runParts(left.size(), [&](int, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
      partners[i] = findStereo(left[i], left_image, right_image, masks, parameters);
  });
  return partners;
}

std::vector<TrackedPoint> trackByCorrelation(const StereoFrame& previous, const ImagePyramid& left,
                                             const ImagePyramid& right, const StereoMasks& masks,
                                             const StereoCamera& camera,
                                             const CorrelationSearch& search, ThreadPool* threads) {
  std::vector<std::optional<TrackedPoint>> found(previous.points.size());
  threads->runParts(found.size(), [&](int, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Keypoint& keypoint = previous.features.points_left[previous.points[i].left];
      const auto level = static_cast<std::size_t>(keypoint.octave);
      if (level == 0 || level >= left.levels.size() ||
          left.ratio(keypoint.octave).x() < search.min_scale)
        continue;
      found[i] = track(previous, static_cast<int>(i), left, right, masks, camera, search);
    }
  });
  std::vector<TrackedPoint> tracked;
  for (const std::optional<TrackedPoint>& point : found) {
    if (point) tracked.push_back(*point);
  }
  return tracked;
}

}  // namespace point_line_odometry
