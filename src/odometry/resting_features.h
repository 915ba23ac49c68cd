#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <tuple>
#include <vector>

#include "common/cell_grid.h"
#include "common/thread_pool.h"
#include "matching/stereo_frame.h"
#include "motion/frame_context.h"
#include "odometry/moving_scene.h"
#include "odometry/tracking_result.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// A part of the image that rests before a scene that moves.
struct RestingBody {
  std::vector<int> points;  ///< that rest, of the previous frame
  Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();  ///< of the camera, by the scene
  int num_scene = 0;  ///< points of the scene that agree on it
};

/// Where features rest in the left image while the scene moves through it: on the robot's own body
/// (bonnet, arm, antenna), on dirt of the lens, in text that a camera writes into its images. They
/// agree that the camera is stationary, and there may be more of them than of the scene's. Learned
/// from the camera's motion, in cells of the image.
class RestingFeatures {
 public:
  /// Nothing is known to rest.
  explicit RestingFeatures(const StereoCamera& camera);

  /// Moves the points of a frame that lie where features rest to its resting points, and removes
  /// the lines there.
  void leaveOut(StereoFrame* frame) const;

  /// After a frame with a motion: learns from the points of the previous frame that should have
  /// moved.
  void learn(const StereoFrame& prev, const StereoFrame& curr, const TrackingResult& tracked,
             const FrameContext& context);

  /// Points by which a camera that moves seems to be stationary, or slower than it is: they rest
  /// and lie before a scene that agrees on another motion. Looked for only if tracking failed or
  /// found hardly anything, or where inliers rest and a quarter of the scene was not found; else,
  /// and if there are none, nothing.
  std::optional<RestingBody> findBeforeScene(const StereoFrame& prev, const StereoFrame& curr,
                                             const TrackingResult& tracked,
                                             const FrameContext& context,
                                             ThreadPool* threads = nullptr) const;

  /// Whether a camera that was found stationary may move all the same: what rests in the image may
  /// be a body before a scene that moves too fast, or shows too little, to be found again. Around
  /// many points that are farther away nothing was found, as would be in the scene of a camera that
  /// is at rest.
  bool mayHideScene(const StereoFrame& prev, const TrackingResult& tracked,
                    const FrameContext& context) const;

  /// Counts what was found in a frame, or that nothing was. Once enough points of the scene agree,
  /// in this frame and those before, features are taken to rest where the body's are, until motions
  /// tell otherwise. A frame that is tracked again counts once, with the most points of the scene.
  /// \return whether this is so now.
  bool confirm(const std::optional<RestingBody>& body, const StereoFrame& prev,
               const StereoFrame& curr, const FrameContext& context);

  /// After a frame without a motion, `dt_s` after the one before. Where this lasts, what rests may
  /// be the scene: all is forgotten.
  void addLost(double dt_s);

  auto state() {
    auto& [last_px, cells, num_scene, confirmed, has_body, share_found, lost_s] = *this;
    return std::tie(last_px, cells, num_scene, confirmed, has_body, share_found, lost_s);
  }

 private:
  /// Points that were expected to move; old ones count less.
  struct Counts {
    std::uint8_t rested = 0;
    std::uint8_t moved = 0;

    auto state() {
      auto& [rested_of_this, moved_of_this] = *this;
      return std::tie(rested_of_this, moved_of_this);
    }
  };

  struct Sums {
    int rested = 0;
    int moved = 0;
  };

  /// A motion that what rests may hold at rest, or near it.
  struct StationaryMotion {
    std::vector<MatchedPoint> inliers;
    std::vector<int> resting;  ///< of these, in the previous frame
  };

  static constexpr int kCellSize_px = 16;

  static void count(bool rests, Counts* counts);
  /// Nothing if tracking failed, found more of the features in view than `most_found`, or if fewer
  /// rest than `least_resting` of the inliers. \param most_found, least_resting shares.
  std::optional<StationaryMotion> findStationary(const StereoFrame& prev,
                                                 const TrackingResult& tracked,
                                                 const FrameContext& context, double most_found,
                                                 double least_resting) const;
  std::vector<int> restingOf(const std::vector<MatchedPoint>& matches,
                             const StereoFrame& prev) const;
  void countResting(const StereoFrame& prev, const StereoFrame& curr,
                    const Eigen::Isometry3d& T_curr_prev, const FrameContext& context);
  Sums around(const Eigen::Vector2f& pixel, int cells) const;
  bool rests(const Eigen::Vector2f& pixel) const;
  bool rests(const LineSegment& segment) const;
  bool mayRest(const Eigen::Vector2f& pixel) const;

  Eigen::Vector2f last_px_;  // of the image
  CellGrid<Counts> cells_;
  int num_scene_ = 0;  // points of a scene behind a body, of frames one after the other
  std::int64_t confirmed_ns_ = -1;  // stamp of the last frame that counts in num_scene_
  bool has_body_ = false;           // one was found before a scene
  double share_found_ = 0.5;        // of the features in view, in the frames before
  double lost_s_ = 0.0;
};

}  // namespace point_line_odometry
