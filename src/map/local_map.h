#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <tuple>
#include <vector>

#include "common/thread_pool.h"
#include "map/bundle_adjustment.h"
#include "map/landmarks.h"
#include "map/map_search.h"
#include "map/new_landmarks.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/frame_context.h"
#include "motion/motion_estimator.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Number of inliers among the first `num_matches` matches; those beyond are not of landmarks.
int countInliers(const std::vector<bool>& inliers, std::size_t num_matches);

int countInView(const LandmarkMatches& landmark_matches);

/// Share of the landmarks in view that were matched and are inliers of a motion.
double shareFound(const LandmarkMatches& landmark_matches, const MotionEstimate& motion);

/// Point and line landmarks observed recently, and the keyframes that observed them, in the map
/// frame, which starts at the first camera. Every frame is tracked against the landmarks; each
/// observation updates its landmark (EKF); keyframes and landmarks are bundle-adjusted in a sliding
/// window. Bounded: the oldest keyframes are culled, and with them the landmarks that no later one
/// observed.
class LocalMap {
 public:
  /// Pose of the previous frame, the one that was added last.
  const Eigen::Isometry3d& T_map_previous() const { return T_map_previous_; }

  /// Matches landmarks with a frame at a predicted pose.
  LandmarkMatches find(const StereoFrame& frame, const FrameContext& context,
                       const Eigen::Isometry3d& T_map_camera, ThreadPool* threads) const;

  /// Aligns the landmarks that the previous frame observed with the images of the context, at a
  /// pose that is accurate to 2 px; no features are needed.
  LandmarkMatches align(const FrameContext& context, const Eigen::Isometry3d& T_map_camera,
                        ThreadPool* threads) const;

  /// The matches as correspondences for the motion since the previous frame.
  Correspondences correspondences(const LandmarkMatches& landmark_matches,
                                  const FrameContext& context) const;

  /// Adds a frame, which becomes the previous one: updates the landmarks of inlier matches, adds
  /// new landmarks where there are few, and makes it a keyframe if it observes few landmarks of the
  /// last one.
  /// \param motion since the previous frame; element i of its inliers belongs to element i of the
  /// landmark matches, those beyond are not of landmarks. \param threads null: the one that calls.
  void add(const StereoFrame& frame, const FrameContext& context,
           const LandmarkMatches& landmark_matches, const MotionEstimate& motion,
           const LandmarkCandidates& candidates, ThreadPool* threads = nullptr);

  /// Updates the landmarks of inlier matches by a frame that does not become the previous one.
  void observe(const FrameContext& context, const LandmarkMatches& landmark_matches,
               const MotionEstimate& motion, ThreadPool* threads);

  /// The bundle adjustment of the window of the last keyframes, once after each new keyframe; none
  /// while there is nothing to adjust.
  std::optional<BundleProblem> takeProblem(const WindowParameters& window);

  /// Applies the result of a bundle adjustment to the keyframes, the previous frame and the
  /// landmarks; landmarks that it culled are removed.
  void applyResult(const BundleProblem& solved);

  const std::vector<MapPoint>& points() const { return points_; }

  std::size_t numPoints() const { return points_.size(); }
  std::size_t numLines() const { return lines_.size(); }
  std::size_t numKeyframes() const { return keyframes_.size(); }
  /// Share of the landmarks in view that were matched and inliers: exponential mean over the last
  /// frames; 0 before the second frame.
  double shareFound() const { return share_found_; }

  /// Share of the landmarks that the previous frame observes which were created by it.
  double shareOfNew() const { return share_of_new_; }

  /// Of the previous frame's pose relative to the landmarks that it observed, in its axes.
  const Matrix6d& previousCovariance() const { return previous_.covariance; }

  /// All members, for StereoOdometry::saveState().
  auto state();

 private:
  template <typename Observation>
  struct Entry {
    std::uint64_t landmark;  ///< its id
    Observation observation;

    auto state() {
      auto& [landmark_of_this, observation_of_this] = *this;
      return std::tie(landmark_of_this, observation_of_this);
    }
  };

  /// A frame with its observations of landmarks.
  struct Observations {
    std::uint64_t id = 0;
    Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
    Matrix6d covariance = Matrix6d::Zero();  ///< of the pose as tracked, in the camera's axes
    /// Of a keyframe: the tracked motion since the last one.
    Eigen::Isometry3d T_last_keyframe_this = Eigen::Isometry3d::Identity();
    std::vector<Entry<PointObservation>> points;
    std::vector<Entry<LineObservation>> lines;

    std::size_t size() const { return points.size() + lines.size(); }
    auto state() {
      auto& [id_of_this, T, covariance_of_this, T_previous, points_of_this, lines_of_this] = *this;
      return std::tie(id_of_this, T, covariance_of_this, T_previous, points_of_this, lines_of_this);
    }
  };

  void movePrevious(const Eigen::Isometry3d& T_previous_camera);
  void updateLandmarks(const StereoCamera& camera, const LandmarkMatches& landmark_matches,
                       const MotionEstimate& motion, ThreadPool* threads, Observations* frame);
  void cullLandmarks();
  void addPoints(const StereoFrame& frame, const FrameContext& context,
                 const LandmarkCandidates& candidates, ThreadPool* threads);
  void addPoint(const StereoFrame& frame, const FrameContext& context, const StereoPoint& stereo,
                MapPoint point);
  void addLines(const StereoFrame& frame, const FrameContext& context,
                const std::vector<int>& candidates, const LandmarkMatches& landmark_matches);
  bool needsKeyframe(const WindowParameters& window) const;
  void addKeyframe(const Parameters& parameters);

  Eigen::Isometry3d T_map_previous_ = Eigen::Isometry3d::Identity();
  std::vector<MapPoint> points_;  // in the order of their ids
  std::vector<MapLine> lines_;    // in the order of their ids
  std::deque<Observations> keyframes_;
  Observations previous_;  // observations of the previous frame
  double share_of_new_ = 1.0;
  double share_found_ = 0.0;
  std::uint64_t next_landmark_ = 0;
  std::uint64_t next_keyframe_ = 0;
  bool keyframe_is_new_ = false;
};

inline auto LocalMap::state() {
  auto& [T_map_previous, points, lines, keyframes, previous, share_of_new, share_found,
         next_landmark, next_keyframe, keyframe_is_new] = *this;
  return std::tie(T_map_previous, points, lines, keyframes, previous, share_of_new, share_found,
                  next_landmark, next_keyframe, keyframe_is_new);
}

}  // namespace point_line_odometry
