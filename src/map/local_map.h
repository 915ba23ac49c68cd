#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <tuple>
#include <vector>

#include "map/bundle_adjustment.h"
#include "map/landmarks.h"
#include "map/map_search.h"
#include "motion/sights.h"
#include "point_line_odometry/matching.h"
#include "point_line_odometry/motion.h"
#include "point_line_odometry/thread_pool.h"

namespace point_line_odometry {

/// Features of a frame from which new landmarks may be made, by their indices in the frame.
struct LandmarkCandidates {
  std::vector<int> points;  ///< inliers of the motion from the previous frame
  std::vector<int> lines;   ///< the same
  /// Points not matched with the previous frame: they came into view, or look other than there.
  std::vector<int> unmatched_points;
};

/// How many of the first so many matches are inliers; beyond them they are of other measurements.
int countInliers(const std::vector<bool>& inliers, std::size_t num_matches);

/// Of the landmarks that should be in view, the share that was found and agrees with a motion.
double shareFound(const MapSights& sights, const MotionEstimate& motion);

/// Points and lines seen lately and the keyframes that saw them, in a frame of the map's own that
/// starts at the first camera. Every frame is measured against the landmarks; each sight of a
/// landmark makes its place better known; keyframes and landmarks are adjusted together over a
/// window of the last keyframes. Bounded: of the keyframes the oldest go, and with them the
/// landmarks that none has seen since.
class LocalMap {
 public:
  LocalMap(const WindowParameters& window, const LocalMapParameters& local_map)
      : window_(window), local_map_(local_map) {}

  /// Pose of the camera at the reference, the frame that was added last.
  const Eigen::Isometry3d& T_map_reference() const { return T_map_reference_; }

  /// Looks for the landmarks in a frame that is expected at a pose.
  MapSights find(const StereoFrame& frame, const FrameContext& context,
                 const Eigen::Isometry3d& T_map_camera, ThreadPool* threads) const;

  /// The sights as measurements of the motion since the reference.
  Correspondences correspondences(const MapSights& sights) const;

  /// A frame becomes the reference: learns from the sights that the motion estimate took for
  /// inliers, takes new landmarks where there are few, and makes it a keyframe if it sees little of
  /// what the last one saw.
  /// \param motion since the old reference; element i of its inliers belongs to element i of the
  /// sights, inliers beyond them are of other measurements.
  void add(const StereoFrame& frame, const FrameContext& context, const MapSights& sights,
           const MotionEstimate& motion, const LandmarkCandidates& candidates);

  /// The window round the last keyframe, once after each new keyframe; none while there is nothing
  /// to adjust.
  std::optional<BundleProblem> takeProblem();

  /// Takes the solution of a problem: keyframes move, the reference and its landmarks with them;
  /// landmarks that it culled are forgotten.
  void adopt(const BundleProblem& solved);

  const std::vector<MapPoint>& points() const { return points_; }

  std::size_t numPoints() const { return points_.size(); }
  std::size_t numLines() const { return lines_.size(); }
  std::size_t numKeyframes() const { return keyframes_.size(); }
  /// Of the landmarks that should be in view, the share that frames have found lately and that
  /// agrees with their motion; 0 before the second frame.
  double shareFound() const { return share_found_; }

  /// Share of what the reference sees that was new with it.
  double shareOfNew() const { return share_of_new_; }

  /// Of the reference's pose against the landmarks that it saw, in its axes.
  const Matrix6d& referenceCovariance() const { return reference_.covariance; }

  /// All that the map holds, for StereoOdometry::saveState(); the parameters are given.
  auto state();

 private:
  template <typename Sight>
  struct Entry {
    std::uint64_t landmark;  ///< its id
    Sight sight;

    auto state() {
      auto& [landmark_of_this, sight_of_this] = *this;
      return std::tie(landmark_of_this, sight_of_this);
    }
  };

  /// A frame with all that it sees of the map.
  struct Observations {
    std::uint64_t id = 0;
    Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
    Matrix6d covariance = Matrix6d::Zero();  ///< of the pose as tracked, in the camera's axes
    /// Of a keyframe: its motion since the last one as tracked.
    Eigen::Isometry3d T_previous_this = Eigen::Isometry3d::Identity();
    std::vector<Entry<PointSight>> points;
    std::vector<Entry<LineSight>> lines;

    std::size_t size() const { return points.size() + lines.size(); }
    auto state() {
      auto& [id_of_this, T, covariance_of_this, T_previous, points_of_this, lines_of_this] = *this;
      return std::tie(id_of_this, T, covariance_of_this, T_previous, points_of_this, lines_of_this);
    }
  };

  void moveReference(const Eigen::Isometry3d& T_reference_camera);
  void learn(const StereoCamera& camera, const MapSights& sights, const MotionEstimate& motion);
  void forget();
  void addPoints(const StereoFrame& frame, const FrameContext& context,
                 const LandmarkCandidates& candidates);
  void addPoint(const StereoFrame& frame, const FrameContext& context, const StereoPoint& stereo);
  void addLines(const StereoFrame& frame, const FrameContext& context,
                const std::vector<int>& candidates, const MapSights& sights);
  bool needsKeyframe() const;
  void addKeyframe();

  WindowParameters window_;
  LocalMapParameters local_map_;
  Eigen::Isometry3d T_map_reference_ = Eigen::Isometry3d::Identity();
  std::vector<MapPoint> points_;  // in the order of their ids
  std::vector<MapLine> lines_;    // in the order of their ids
  std::deque<Observations> keyframes_;
  Observations reference_;  // what the last frame saw
  double share_of_new_ = 1.0;
  double share_found_ = 0.0;
  std::uint64_t next_landmark_ = 0;
  std::uint64_t next_keyframe_ = 0;
  bool keyframe_is_new_ = false;
};

inline auto LocalMap::state() {
  auto& [window, local_map, T_map_reference, points, lines, keyframes, reference, share_of_new,
         share_found, next_landmark, next_keyframe, keyframe_is_new] = *this;
  static_cast<void>(window);
  static_cast<void>(local_map);
  return std::tie(T_map_reference, points, lines, keyframes, reference, share_of_new, share_found,
                  next_landmark, next_keyframe, keyframe_is_new);
}

}  // namespace point_line_odometry
