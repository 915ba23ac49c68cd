#include "odometry/moving_scene.h"

#include <cstddef>
#include <limits>

#include "matching/appearance_matcher.h"
#include "motion/motion_consensus.h"
#include "motion/motion_estimator.h"
#include "motion/observations.h"
#include "odometry/motion_confirmation.h"

namespace point_line_odometry {
namespace {

constexpr double kShareOfMoving = 1.0 / 3.0;

// Of the squared shifts of a scene that noise leaves where the scene is at rest nearly all are
// residuals of any motion.
constexpr double kShareUnexplained = 0.5;

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

}  // namespace

const Eigen::Vector2f& leftPixel(const StereoFrame& frame, const StereoPoint& point) {
  return frame.features.points_left[point.left].pixel;
}

double levelScaleOf(const StereoFrame& frame, const StereoPoint& point,
                    const FrameContext& context) {
  return levelScale(frame.features.points_left[point.left], context.parameters);
}

double shiftOf(const IndexPair& match, const StereoFrame& prev, const StereoFrame& curr,
               const FrameContext& context) {
  const StereoPoint& before = prev.points[match.first];
  return (leftPixel(curr, curr.points[match.second]) - leftPixel(prev, before)).norm() /
         levelScaleOf(prev, before, context);
}

double expectedShift(const StereoFrame& prev, const StereoPoint& point,
                     const Eigen::Isometry3d& T_curr_prev, const FrameContext& context) {
  const StereoCamera& camera = context.camera;
  const Eigen::Vector3d& p_prev = point.triangulated.p_camera;
  const Eigen::Vector3d p_curr = point.far ? T_curr_prev.linear() * p_prev : T_curr_prev * p_prev;
  if (!(p_curr.z() > 0.1 * camera.baseline_m)) return std::numeric_limits<double>::infinity();
  const Eigen::Vector2d shift =
      camera.projectLeft(p_curr) - camera.projectLeft(point.triangulated.p_camera);
  return shift.norm() / levelScaleOf(prev, point, context);
}

std::vector<IndexPair> inliersOf(const TrackingResult& tracked, const StereoFrame& prev) {
  std::vector<IndexPair> inliers;
  const MotionEstimate& motion = tracked.frame_to_frame;
  for (std::size_t i = 0; motion.ok() && i < tracked.matches.points.size(); ++i) {
    const IndexPair& match = tracked.matches.points[i];
    if (motion.point_inliers[i] && !prev.points[match.first].far) inliers.push_back(match);
  }
  return inliers;
}

std::vector<IndexPair> matchOthers(const StereoFrame& prev, const StereoFrame& curr,
                                   const std::vector<IndexPair>& inliers,
                                   const MatchingParameters& parameters, ThreadPool* threads) {
  std::vector<bool> matched_before(prev.points.size(), false);
  std::vector<bool> matched_now(curr.points.size(), false);
  for (const auto& [i, k] : inliers) matched_before[i] = matched_now[k] = true;
  const RemainingPoints before(prev, matched_before);
  const RemainingPoints now(curr, matched_now);
  std::vector<IndexPair> matches;
  for (const auto& [i, k] :
       matchByAppearance(before.descriptors, now.descriptors, parameters, threads))
    matches.push_back({before.indices[i], now.indices[k]});
  return matches;
}

std::vector<PointCorrespondence> movingInliers(const TrackingResult& tracked,
                                               const StereoFrame& prev,
                                               const FrameContext& context) {
  std::vector<PointCorrespondence> moving;
  const MotionEstimate& motion = tracked.frame_to_frame;
  for (std::size_t i = 0; motion.ok() && i < tracked.matches.points.size(); ++i) {
    PointCorrespondence point = tracked.correspondences.points[i];
    if (!motion.point_inliers[i] || point.far) continue;
    const StereoPoint& before = prev.points[tracked.matches.points[i].first];
    const double scale = levelScaleOf(prev, before, context);
    const Eigen::Vector2d before_px = leftPixel(prev, before).cast<double>();
    if ((point.left_px - before_px).norm() < kRests_px * scale) continue;
    point.sigma_px = scale;  // as of a point that is not aligned
    moving.push_back(point);
  }
  return moving;
}

std::vector<PointCorrespondence> movingMatches(const std::vector<IndexPair>& matches,
                                               const StereoFrame& prev, const StereoFrame& curr,
                                               const FrameContext& context) {
  std::vector<PointCorrespondence> moving;
  for (const IndexPair& match : matches) {
    if (shiftOf(match, prev, curr, context) < kRests_px) continue;
    const StereoPoint& before = prev.points[match.first];
    const StereoPoint& now = curr.points[match.second];
    moving.push_back({pointObservation(leftPixel(curr, now), now.right_px,
                                       levelScaleOf(prev, before, context), context),
                      before.triangulated.p_camera});
  }
  return moving;
}

std::optional<MovingScene> findMovingScene(const std::vector<PointCorrespondence>& moving,
                                           const FrameContext& context) {
  const StereoCamera& camera = context.camera;
  const std::optional<MotionConsensus> consensus = findConsensus(moving, camera);
  if (!consensus || consensus->num_inliers < kShareOfMoving * static_cast<double>(moving.size()))
    return std::nullopt;
  Correspondences agreeing;
  for (std::size_t i = 0; i < moving.size(); ++i) {
    if (consensus->inliers[i]) agreeing.points.push_back(moving[i]);
  }
  const MotionEstimate motion =
      estimateMotion(agreeing, camera, consensus->T_curr_prev, context.parameters.motion);
  if (!motion.ok()) return std::nullopt;
  MovingScene scene{motion.T_curr_prev, {}};
  double squares_px2 = 0.0;  // of the shifts, for each coordinate
  for (std::size_t i = 0; i < agreeing.points.size(); ++i) {
    if (!motion.point_inliers[i]) continue;
    const PointCorrespondence& point = agreeing.points[i];
    scene.depths.push_back(point.p_prev.z());
    squares_px2 += 0.5 * (point.left_px - camera.projectLeft(point.p_prev)).squaredNorm();
  }
  const double residual_squares_px2 =
      motion.rms_px * motion.rms_px * static_cast<double>(scene.depths.size());
  if (residual_squares_px2 > kShareUnexplained * squares_px2) return std::nullopt;
  return scene;
}

}  // namespace point_line_odometry
