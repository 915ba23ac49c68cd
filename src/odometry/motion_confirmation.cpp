#include "odometry/motion_confirmation.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "motion/observations.h"

namespace point_line_odometry {
namespace {

// The share of landmarks found is not looked at where fewer are expected.
constexpr double kMinExpected = 10.0;

// A place is not recognized by fewer inliers.
constexpr int kMinRecognized = 20;

// Landmarks of the previous frame that are found again without features: at least this number and
// this share.
constexpr int kMinFoundAgain = 30;
constexpr double kShareFoundAgain = 0.6;

// Resting far points that may hold a motion: this number and this share of its inliers, where fewer
// of the other features are found than by a stationary camera. Without them the scene's motion has
// more inliers by this factor.
constexpr int kMinRestingFar = 8;
constexpr double kShareRestingFar = 0.2;
constexpr double kGainOfFreed = 1.1;

// A number of features that are found by chance is seldom exceeded by more.
constexpr double kSigmasAboveChance = 2.0;

/// Far points among the inliers from frame to frame.
int countFarInliers(const TrackingResult& tracked) {
  if (!tracked.frame_to_frame.ok()) return 0;
  const std::vector<PointCorrespondence>& matches = tracked.correspondences.points;
  int far = 0;
  for (std::size_t i = 0; i < matches.size(); ++i)
    far += tracked.frame_to_frame.point_inliers[i] && matches[i].far ? 1 : 0;
  return far;
}

/// The points among the inliers from frame to frame.
bool areMostlyFar(const TrackingResult& tracked) {
  return 2 * countFarInliers(tracked) > tracked.frame_to_frame.num_point_inliers;
}

/// Inliers from frame to frame that have a depth.
int countNearInliers(const TrackingResult& tracked) {
  const MotionEstimate& motion = tracked.frame_to_frame;
  return motion.num_point_inliers - countFarInliers(tracked) + motion.num_line_inliers;
}

/// Features of an earlier frame that have a depth and are in view after a motion.
int countNearInView(const StereoFrame& earlier, const StereoCamera& camera,
                    const Eigen::Isometry3d& T_curr_prev) {
  const auto in_view = [&](const Eigen::Vector3d& p_earlier) {
    const Eigen::Vector3d p = T_curr_prev * p_earlier;
    if (!(p.z() > camera.baseline_m)) return false;
    const Eigen::Vector2d left = camera.projectLeft(p);
    return left.x() >= 0.0 && left.y() >= 0.0 && left.x() < camera.width &&
           left.y() < camera.height && camera.projectRight(p).x() >= 0.0;
  };
  const auto points = std::count_if(
      earlier.points.begin(), earlier.points.end(),
      [&](const StereoPoint& point) { return !point.far && in_view(point.triangulated.p_camera); });
  const auto lines =
      std::count_if(earlier.lines.begin(), earlier.lines.end(), [&](const StereoLine& line) {
        return line.triangulated &&
               (in_view(line.triangulated->start_camera) || in_view(line.triangulated->end_camera));
      });
  return static_cast<int>(points + lines);
}

}  // namespace

double shareFound(const StereoFrame& earlier, const StereoCamera& camera,
                  const TrackingResult& tracked) {
  const MotionEstimate& motion = tracked.frame_to_frame;
  if (!motion.ok()) return 0.0;
  return countNearInliers(tracked) /
         std::max<double>(1.0, countNearInView(earlier, camera, motion.T_curr_prev));
}

double shareAgreeing(const TrackingResult& tracked) {
  const Correspondences& matches = tracked.correspondences;
  const auto num_matches = static_cast<double>(matches.points.size() + matches.lines.size());
  return tracked.frame_to_frame.numInliers() / std::max(1.0, num_matches);
}

std::vector<bool> restingThatMayHold(const StereoFrame& earlier, const StereoFrame& curr,
                                     const FrameContext& context, const TrackingResult& tracked) {
  const MotionEstimate& motion = tracked.frame_to_frame;
  if (!motion.ok()) return {};
  std::vector<bool> resting;
  int num_resting = 0;
  for (std::size_t i = 0; i < tracked.matches.points.size(); ++i) {
    const auto& [before, now] = tracked.matches.points[i];
    const StereoPoint& point = earlier.points[before];
    const Keypoint& left = earlier.features.points_left[point.left];
    const Eigen::Vector2f shift =
        curr.features.points_left[curr.points[now].left].pixel - left.pixel;
    resting.push_back(point.far && shift.norm() < kRests_px * levelScale(left, context.parameters));
    num_resting += resting[i] && motion.point_inliers[i] ? 1 : 0;
  }
  const int num_inliers = motion.numInliers();
  if (num_resting < kMinRestingFar || num_resting < kShareRestingFar * num_inliers) return {};
  const int in_view = countNearInView(earlier, context.camera, motion.T_curr_prev);
  const bool may_hold =
      in_view > num_resting && countNearInliers(tracked) < kShareStationary * in_view;
  return may_hold ? resting : std::vector<bool>();
}

bool isFreed(const StereoFrame& earlier, const StereoCamera& camera, const TrackingResult& held,
             const TrackingResult& freed) {
  return countNearInliers(freed) > kGainOfFreed * countNearInliers(held) ||
         shareFound(earlier, camera, held) < kShareOfScene;
}

bool isRefuted(const TrackingResult& tracked, const FrameHistory& history,
               const StereoCamera& camera) {
  const double usual = history.map->shareFound();
  const double landmarks = shareFound(tracked.landmark_matches, tracked.motion);
  if (usual * countInView(tracked.landmark_matches) < kMinExpected ||
      landmarks >= kShareConfirmed * usual)
    return false;
  if (areMostlyFar(tracked)) return false;
  const double features = shareFound(*history.previous, camera, tracked);
  return features < kShareFound && landmarks < kShareConfirmed * features;
}

bool isByChance(const StereoFrame& earlier, const StereoCamera& camera,
                const TrackingResult& tracked) {
  const MotionEstimate& motion = tracked.frame_to_frame;
  if (!motion.ok() || areMostlyFar(tracked)) return false;
  const int in_view = countNearInView(earlier, camera, motion.T_curr_prev);
  const double by_chance = kShareOfScene * in_view;
  return countNearInliers(tracked) <=
         by_chance + kSigmasAboveChance * std::sqrt((1.0 - kShareOfScene) * by_chance);
}

bool isFoundAgain(const TrackingResult& tracked) {
  return tracked.motion.numInliers() >= kMinFoundAgain &&
         shareFound(tracked.landmark_matches, tracked.motion) >= kShareFoundAgain;
}

bool isConfirmed(const LocalMap& map, const LandmarkMatches& landmark_matches,
                 const MotionEstimate& motion, double least) {
  return map.shareFound() * countInView(landmark_matches) >= kMinExpected &&
         shareFound(landmark_matches, motion) >= least * map.shareFound();
}

bool isPlaceRecognized(const LocalMap& map, const LandmarkMatches& landmark_matches,
                       const MotionEstimate& motion, double least) {
  return motion.numInliers() >= kMinRecognized && isConfirmed(map, landmark_matches, motion, least);
}

}  // namespace point_line_odometry
