#include "motion/camera_motion.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace point_line_odometry {
namespace {

// How much a robot's velocity may change from frame to frame.
constexpr double kMaxAcceleration = 3.0;         // [m/s^2]
constexpr double kMaxAngularAcceleration = 3.0;  // [rad/s^2]

constexpr double kShareOfMost = 0.5;        // of all matches: so many need not be doubted
constexpr double kShareOfNearest = 0.2;     // of all matches, by which a second opinion begins
constexpr double kShareOfFollowers = 0.15;  // of all matches: fewer are no second opinion
constexpr double kFollows_px = 2.0;         // how far a match may be from a motion to be of it

bool isNear(const Eigen::Isometry3d& T_a, const Eigen::Isometry3d& T_b, double dt_s) {
  const Eigen::Isometry3d T_change = T_a * T_b.inverse();
  return T_change.translation().norm() <= kMaxAcceleration * dt_s * dt_s &&
         Eigen::AngleAxisd(T_change.linear()).angle() <= kMaxAngularAcceleration * dt_s * dt_s;
}

std::size_t numMatches(const Correspondences& matches) {
  return matches.points.size() + matches.lines.size();
}

int numInliers(const MotionEstimate& motion) {
  return motion.num_point_inliers + motion.num_line_inliers;
}

constexpr double kNowhere = std::numeric_limits<double>::infinity();

/// A distance that can be compared with others.
double comparable(double distance_px) {
  return std::isfinite(distance_px) ? distance_px : kNowhere;
}

/// How far from where a motion says a point is seen in the left image [px].
double distance(const PointCorrespondence& match, const StereoCamera& camera,
                const Eigen::Isometry3d& T_curr_prev) {
  const Eigen::Vector3d p = T_curr_prev * match.p_prev;
  return p.z() > 0.0 ? comparable((camera.projectLeft(p) - match.left_px).norm()) : kNowhere;
}

/// The same for a line, across its direction.
double distance(const LineCorrespondence& match, const StereoCamera& camera,
                const Eigen::Isometry3d& T_curr_prev) {
  const Eigen::Vector3d a = T_curr_prev * match.start_prev;
  const Eigen::Vector3d b = T_curr_prev * match.end_prev;
  if (!(a.z() > 0.0 && b.z() > 0.0)) return kNowhere;
  const Eigen::Vector2d start = camera.projectLeft(a);
  const Eigen::Vector2d along = (camera.projectLeft(b) - start).normalized();
  const Eigen::Vector2d across(-along.y(), along.x());
  return std::max(comparable(std::abs(across.dot(match.left_start_px - start))),
                  comparable(std::abs(across.dot(match.left_end_px - start))));
}

/// The distance within which a share of all matches lies.
double distanceOfNearest(double share, const Correspondences& matches, const StereoCamera& camera,
                         const Eigen::Isometry3d& T_curr_prev) {
  std::vector<double> distances;
  distances.reserve(numMatches(matches));
  for (const auto& match : matches.points) {
    distances.push_back(distance(match, camera, T_curr_prev));
  }
  for (const auto& match : matches.lines) distances.push_back(distance(match, camera, T_curr_prev));
  const auto last = static_cast<std::ptrdiff_t>(share * static_cast<double>(distances.size()));
  std::nth_element(distances.begin(), distances.begin() + last, distances.end());
  return distances[static_cast<std::size_t>(last)];
}

/// Some of the matches, and which they are.
struct Part {
  Correspondences matches;
  std::vector<bool> points;
  std::vector<bool> lines;
};

Part within(double limit_px, const Correspondences& matches, const StereoCamera& camera,
            const Eigen::Isometry3d& T_curr_prev) {
  Part part;
  for (const auto& match : matches.points) {
    part.points.push_back(distance(match, camera, T_curr_prev) <= limit_px);
    if (part.points.back()) part.matches.points.push_back(match);
  }
  for (const auto& match : matches.lines) {
    part.lines.push_back(distance(match, camera, T_curr_prev) <= limit_px);
    if (part.lines.back()) part.matches.lines.push_back(match);
  }
  return part;
}

/// Flags of all matches from those of a part.
std::vector<bool> spread(const std::vector<bool>& flags_of_part, const std::vector<bool>& part) {
  std::vector<bool> flags(part.size(), false);
  std::size_t next = 0;
  for (std::size_t i = 0; i < part.size(); ++i) {
    if (part[i]) flags[i] = flags_of_part[next++];
  }
  return flags;
}

/// The motion of those matches that are nearest to the predicted one, and of all that follow it.
MotionEstimate motionOfNearest(const Correspondences& matches, const StereoCamera& camera,
                               const Eigen::Isometry3d& T_curr_prev_predicted,
                               const MotionParameters& parameters) {
  const double limit_px =
      distanceOfNearest(kShareOfNearest, matches, camera, T_curr_prev_predicted);
  const MotionEstimate nearest =
      estimateMotion(within(limit_px, matches, camera, T_curr_prev_predicted).matches, camera,
                     T_curr_prev_predicted, parameters);
  if (!nearest.ok()) return nearest;
  const Part followers = within(kFollows_px, matches, camera, nearest.T_curr_prev);
  MotionEstimate motion =
      estimateMotion(followers.matches, camera, nearest.T_curr_prev, parameters);
  motion.point_inliers = spread(motion.point_inliers, followers.points);
  motion.line_inliers = spread(motion.line_inliers, followers.lines);
  return motion;
}

}  // namespace

MotionEstimate estimateCameraMotion(const Correspondences& correspondences,
                                    const StereoCamera& camera,
                                    const Eigen::Isometry3d& T_curr_prev_predicted, double dt_s,
                                    const MotionParameters& parameters) {
  MotionEstimate most = estimateMotion(correspondences, camera, T_curr_prev_predicted, parameters);
  const auto all = static_cast<double>(numMatches(correspondences));
  if (all < parameters.min_matches) return most;
  const bool is_near = most.ok() && isNear(most.T_curr_prev, T_curr_prev_predicted, dt_s);
  if (is_near && numInliers(most) >= kShareOfMost * all) return most;

  MotionEstimate other =
      motionOfNearest(correspondences, camera, T_curr_prev_predicted, parameters);
  const double fewest = is_near ? numInliers(most) + 1.0 : kShareOfFollowers * all;
  const bool holds = other.ok() && isNear(other.T_curr_prev, T_curr_prev_predicted, dt_s) &&
                     numInliers(other) >= fewest;
  return holds ? other : most;
}

}  // namespace point_line_odometry
