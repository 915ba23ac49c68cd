#include "odometry/moving_scene.h"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "matching/appearance_matcher.h"
#include "motion/motion_consensus.h"
#include "motion/motion_estimator.h"
#include "motion/observations.h"

namespace point_line_odometry {
namespace {

// Of what noise moves, some motion leaves less than half of the squared shift of 30 % of the
// points, but hardly less than a quarter.
constexpr double kShareOfMoving = 0.3;
constexpr double kShareUnexplained = 0.25;

/// Descriptors of the points of a frame but some.
struct RemainingPoints {
  std::vector<int> indices;
  std::vector<StereoDescriptor> descriptors;

  RemainingPoints(const StereoFrame& frame, const std::vector<bool>& without) {
    const std::vector<StereoDescriptor> all = stereoDescriptors(frame);
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (without[i] || frame.points[i].far) continue;
      indices.push_back(static_cast<int>(i));
      descriptors.push_back(all[i]);
    }
  }
};

/// \param point with the pixel of each image.
MatchedPoint matchedPoint(int index, PointCorrespondence point, const StereoFrame& prev,
                          const FrameContext& context) {
  point.sigma_px = levelScaleOf(prev, prev.points[index], context);
  const Eigen::Vector2d before_px = context.camera.projectLeft(point.p_prev);
  return {index, point, (point.left_px - before_px).norm() / point.sigma_px};
}

/// Whether a motion moves a point to near where it was found.
bool explains(const Eigen::Isometry3d& T_curr_prev, const PointCorrespondence& point,
              const StereoCamera& camera) {
  const Eigen::Vector3d p_curr = T_curr_prev * point.p_prev;
  if (!(p_curr.z() > 0.1 * camera.baseline_m)) return false;
  const double shift = (point.left_px - camera.projectLeft(point.p_prev)).squaredNorm();
  return (point.left_px - camera.projectLeft(p_curr)).squaredNorm() < kShareUnexplained * shift;
}

}  // namespace

const Eigen::Vector2f& leftPixel(const StereoFrame& frame, const StereoPoint& point) {
  return frame.features.points_left[point.left].pixel;
}

double levelScaleOf(const StereoFrame& frame, const StereoPoint& point,
                    const FrameContext& context) {
  return levelScale(frame.features.points_left[point.left], context.parameters);
}

double shiftBetween(const StereoFrame& prev, const StereoPoint& point,
                    const Eigen::Isometry3d& T_curr_prev, const Eigen::Isometry3d& other,
                    const FrameContext& context) {
  const StereoCamera& camera = context.camera;
  const Eigen::Vector3d& p_prev = point.triangulated.p_camera;
  const auto move = [&](const Eigen::Isometry3d& T) -> Eigen::Vector3d {
    return point.far ? T.linear() * p_prev : T * p_prev;
  };
  const Eigen::Vector3d p = move(T_curr_prev);
  const Eigen::Vector3d p_other = move(other);
  if (!(std::min(p.z(), p_other.z()) > 0.1 * camera.baseline_m))
    return std::numeric_limits<double>::infinity();
  return (camera.projectLeft(p) - camera.projectLeft(p_other)).norm() /
         levelScaleOf(prev, point, context);
}

std::vector<MatchedPoint> matchedInliers(const TrackingResult& tracked, const StereoFrame& prev,
                                         const FrameContext& context) {
  std::vector<MatchedPoint> inliers;
  const MotionEstimate& motion = tracked.frame_to_frame;
  for (std::size_t i = 0; motion.ok() && i < tracked.matches.points.size(); ++i) {
    const int index = tracked.matches.points[i].first;
    if (!motion.point_inliers[i] || prev.points[index].far) continue;
    inliers.push_back(matchedPoint(index, tracked.correspondences.points[i], prev, context));
  }
  return inliers;
}

std::vector<MatchedPoint> matchOthers(const StereoFrame& prev, const StereoFrame& curr,
                                      const TrackingResult& tracked, const FrameContext& context,
                                      ThreadPool* threads) {
  std::vector<bool> matched_before(prev.points.size(), false);
  std::vector<bool> matched_now(curr.points.size(), false);
  const MotionEstimate& motion = tracked.frame_to_frame;
  for (std::size_t i = 0; motion.ok() && i < tracked.matches.points.size(); ++i) {
    if (!motion.point_inliers[i]) continue;
    const auto& [before, now] = tracked.matches.points[i];
    matched_before[before] = matched_now[now] = true;
  }
  const RemainingPoints before(prev, matched_before);
  const RemainingPoints now(curr, matched_now);
  std::vector<MatchedPoint> others;
  for (const auto& [i, k] : matchByAppearance(before.descriptors, now.descriptors,
                                              context.parameters.matching, threads)) {
    const int index = before.indices[i];
    const StereoPoint& found = curr.points[now.indices[k]];
    const TriangulatedPoint& known = prev.points[index].triangulated;
    const PointCorrespondence point{
        pointObservation(leftPixel(curr, found), found.right_px, 1.0, context), known.p_camera,
        known.covariance};
    others.push_back(matchedPoint(index, point, prev, context));
  }
  return others;
}

std::optional<MovingScene> findMovingScene(const std::vector<MatchedPoint>& matches,
                                           double least_px, const FrameContext& context) {
  const StereoCamera& camera = context.camera;
  std::vector<PointCorrespondence> moving;
  for (const MatchedPoint& match : matches) {
    if (match.shift_px >= least_px) moving.push_back(match.point);
  }
  const std::optional<MotionConsensus> consensus = findConsensus(moving, camera);
  if (!consensus) return std::nullopt;
  Correspondences agreeing;
  for (std::size_t i = 0; i < moving.size(); ++i) {
    if (consensus->inliers[i]) agreeing.points.push_back(moving[i]);
  }
  const MotionEstimate motion =
      estimateMotion(agreeing, camera, consensus->T_curr_prev, context.parameters.motion);
  if (!motion.ok()) return std::nullopt;
  MovingScene scene{motion.T_curr_prev, {}};
  for (const PointCorrespondence& point : agreeing.points) {
    if (explains(scene.T_curr_prev, point, camera)) scene.depths.push_back(point.p_prev.z());
  }
  const double least =
      std::max<double>(kMinConsensus, kShareOfMoving * static_cast<double>(moving.size()));
  if (static_cast<double>(scene.depths.size()) < least) return std::nullopt;
  return scene;
}

}  // namespace point_line_odometry
