#include "odometry/motion_confirmation.h"

#include <algorithm>
#include <vector>

namespace point_line_odometry {
namespace {

// At a right motion the share of landmarks found is at least this fraction of that in the frames
// before (in all sequences that are never lost), and of the share of features found. It is not
// looked at where fewer landmarks are expected.
constexpr double kShareConfirmed = 0.5;
constexpr double kMinExpected = 10.0;

// Relocalization needs this number of inliers, and this fraction of the share of landmarks that is
// found from frame to frame.
constexpr int kMinRecognized = 20;
constexpr double kShareRecognized = 0.7;

/// Far points among the inliers from frame to frame.
int countFarInliers(const TrackingResult& tracked) {
  if (!tracked.frame_to_frame.ok()) return 0;
  const std::vector<PointCorrespondence>& matches = tracked.correspondences.points;
  int far = 0;
  for (std::size_t i = 0; i < matches.size(); ++i)
    far += tracked.frame_to_frame.point_inliers[i] && matches[i].far ? 1 : 0;
  return far;
}

}  // namespace

double shareFound(const StereoFrame& earlier, const StereoCamera& camera,
                  const TrackingResult& tracked) {
  const MotionEstimate& motion = tracked.frame_to_frame;
  if (!motion.ok()) return 0.0;
  const auto in_view = [&](const Eigen::Vector3d& p_earlier) {
    const Eigen::Vector3d p = motion.T_curr_prev * p_earlier;
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
  const int found = motion.num_point_inliers - countFarInliers(tracked) + motion.num_line_inliers;
  return found / std::max<double>(1.0, static_cast<double>(points + lines));
}

bool isRefuted(const TrackingResult& tracked, const FrameHistory& history,
               const StereoCamera& camera) {
  const double usual = history.map->shareFound();
  const double landmarks = shareFound(tracked.landmark_matches, tracked.motion);
  if (usual * countInView(tracked.landmark_matches) < kMinExpected ||
      landmarks >= kShareConfirmed * usual)
    return false;
  if (2 * countFarInliers(tracked) > tracked.frame_to_frame.num_point_inliers) return false;
  const double features = shareFound(*history.previous, camera, tracked);
  return features < kShareFound && landmarks < kShareConfirmed * features;
}

bool isPlaceRecognized(const LocalMap& map, const LandmarkMatches& landmark_matches,
                       const MotionEstimate& motion) {
  return motion.num_point_inliers + motion.num_line_inliers >= kMinRecognized &&
         shareFound(landmark_matches, motion) >= kShareRecognized * map.shareFound();
}

}  // namespace point_line_odometry
