#include "odometry/correspondences.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include "matching/patch_warp.h"
#include "motion/observations.h"

namespace point_line_odometry {
namespace {

/// Warp of the patch around a point of an earlier frame to both images of the current one.
std::optional<StereoWarp> warpOf(const StereoPoint& point, const Eigen::Isometry3d& T_curr_earlier,
                                 const StereoCamera& camera) {
  return stereoPatchWarp(camera, T_curr_earlier * point.triangulated.p_camera,
                         T_curr_earlier.linear() * pixelAxes(camera, point));
}

/// The patch around a point of an earlier frame in an octave of its image, warped to both images of
/// the current one.
StereoPatch patchOf(const ImagePyramid& earlier_image, const Eigen::Vector2f& pixel, int octave,
                    const std::optional<StereoWarp>& warp) {
  const cv::Mat& image = earlier_image.levels[static_cast<std::size_t>(octave)];
  const Eigen::Vector2f level_px = earlier_image.toLevel(pixel, octave);
  if (warp) return StereoPatch(image, level_px, *warp);
  return StereoPatch(PatchAligner(image, level_px));
}

/// A keypoint where it was detected, with the noise of a whole pixel of its level.
AlignedPatch unaligned(const Keypoint& keypoint, const ImagePyramid& image) {
  AlignedPatch point{keypoint.pixel};
  point.noise_px *= image.ratio(keypoint.octave).maxCoeff();
  return point;
}

PointCorrespondence makeCorrespondence(const StereoFrame& earlier, const StereoPoint& before,
                                       const StereoFrame& curr, const StereoPoint& now,
                                       const Eigen::Isometry3d& T_curr_earlier,
                                       const FrameContext& context) {
  AlignedPatch left = unaligned(curr.features.points_left[now.left], context.left);
  AlignedPatch right = unaligned(curr.features.points_right[now.right], context.right);
  double patch_px = 0.0;
  if (context.parameters.matching.refine_subpixel) {
    const Keypoint& keypoint = earlier.features.points_left[before.left];
    const int octave = keypoint.octave;
    const StereoPatch patch = patchOf(earlier.left_image, keypoint.pixel, octave,
                                      warpOf(before, T_curr_earlier, context.camera));
    const StereoMasks& masks = context.masks;
    const auto aligned_left =
        alignInOctave(patch.left, context.left, masks.left, octave, left.pixel);
    const auto aligned_right =
        alignInOctave(patch.right, context.right, masks.right, octave, right.pixel);
    left = aligned_left.value_or(left);
    right = aligned_right.value_or(right);
    if (aligned_left && aligned_right)
      patch_px = earlier.left_image.ratio(octave).maxCoeff() * PatchAligner::kSide;
  }
  const double sigma_px =
      pointSigma(context, std::max(left.noise_px, right.noise_px),
                 levelScale(earlier.features.points_left[before.left], context.parameters));
  PointObservation observation = pointObservation(left.pixel, right.pixel, sigma_px, context);
  observation.patch_px = patch_px;
  return {observation, before.triangulated.p_camera, before.triangulated.covariance, before.far};
}

}  // namespace

Correspondences makeCorrespondences(const StereoFrame& earlier, const StereoFrame& curr,
                                    const CircularMatches& matches,
                                    const Eigen::Isometry3d& T_curr_earlier,
                                    const FrameContext& context, ThreadPool* threads) {
  Correspondences correspondences;
  correspondences.disparity_error_px = context.correction.disparity_error_px;
  correspondences.shutter = context.shutter;
  correspondences.points.resize(matches.points.size());
  const auto make_points = [&](int, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const StereoPoint& before = earlier.points[matches.points[i].first];
      const StereoPoint& now = curr.points[matches.points[i].second];
      correspondences.points[i] =
          makeCorrespondence(earlier, before, curr, now, T_curr_earlier, context);
    }
  };
  runParts(threads, matches.points.size(), make_points);
  correspondences.lines.reserve(matches.lines.size());
  for (const IndexPair& match : matches.lines) {
    const StereoLine& before = earlier.lines[match.first];
    LineCorrespondence line;
    static_cast<LineObservation&>(line) =
        lineObservation(curr.features, curr.lines[match.second], context);
    line.start_prev = before.triangulated->start_camera;
    line.end_prev = before.triangulated->end_camera;
    line.covariance = before.triangulated->covariance;
    correspondences.lines.push_back(line);
  }
  return correspondences;
}

Correspondences alignCoarsely(const StereoFrame& earlier, const ImagePyramid& earlier_image,
                              const Eigen::Isometry3d& T_curr_earlier, const FrameContext& context,
                              ThreadPool* threads) {
  constexpr std::size_t kMostPoints = 80;
  const int octave = static_cast<int>(earlier_image.levels.size()) - 1;
  const std::size_t step = std::max<std::size_t>(1, earlier.points.size() / kMostPoints);
  const std::size_t count = earlier.points.size() / step;
  std::vector<std::optional<PointCorrespondence>> aligned(count);
  runParts(threads, count, [&](int, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const StereoPoint& point = earlier.points[i * step];
      const Eigen::Vector3d p = T_curr_earlier * point.triangulated.p_camera;
      const auto warp = warpOf(point, T_curr_earlier, context.camera);
      if (!warp) continue;
      const Eigen::Vector2f& pixel = earlier.features.points_left[point.left].pixel;
      const std::optional<PointObservation> seen =
          alignPoint(patchOf(earlier_image, pixel, octave, warp), octave,
                     context.camera.projectLeft(p).cast<float>(),
                     context.camera.projectRight(p).cast<float>(), context);
      if (!seen) continue;
      aligned[i] = PointCorrespondence{*seen, point.triangulated.p_camera,
                                       point.triangulated.covariance, point.far};
    }
  });
  Correspondences correspondences;
  correspondences.disparity_error_px = context.correction.disparity_error_px;
  for (const std::optional<PointCorrespondence>& match : aligned) {
    if (match) correspondences.points.push_back(*match);
  }
  return correspondences;
}

bool warpsDiffer(const StereoFrame& earlier, const CircularMatches& matches,
                 const MotionEstimate& motion, const Eigen::Isometry3d& T_curr_earlier,
                 const StereoCamera& camera) {
  constexpr double kMaxChange = 0.02;
  constexpr double kMinShare = 0.1;
  int changed = 0;
  for (std::size_t i = 0; i < matches.points.size(); ++i) {
    if (!motion.point_inliers[i]) continue;
    const StereoPoint& point = earlier.points[matches.points[i].first];
    const auto before = warpOf(point, T_curr_earlier, camera);
    const auto now = warpOf(point, motion.T_curr_prev, camera);
    if (!now) continue;
    const Eigen::Matrix2f change =
        before ? Eigen::Matrix2f(now->left * before->left.inverse()) : now->left;
    // Of a scale 1 + s, or a roll by s, the norm is sqrt(2) s.
    const double size = (change - Eigen::Matrix2f::Identity()).norm() / std::sqrt(2.0);
    changed += size > kMaxChange ? 1 : 0;
  }
  return changed > kMinShare * motion.num_point_inliers;
}

}  // namespace point_line_odometry
