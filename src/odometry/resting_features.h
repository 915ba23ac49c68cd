#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <tuple>
#include <vector>

#include "common/cell_grid.h"
#include "matching/stereo_frame.h"
#include "motion/frame_context.h"
#include "odometry/frame_tracker.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Where features rest in the left image while the scene moves through it: on the robot's own body
/// (bonnet, arm, antenna), on dirt of the lens. They agree that the camera is stationary, and there
/// may be more of them than of the scene's. Learned from the camera's motion, in cells of the
/// image.
class RestingFeatures {
 public:
  /// Nothing is known to rest.
  explicit RestingFeatures(const StereoCamera& camera);

  /// Moves the points of a frame that lie where features rest to its resting points, and removes
  /// the lines there.
  void leaveOut(StereoFrame* frame) const;

  /// Counts the points of the previous frame that a motion should have moved: those that are found
  /// where they were, and the others.
  void learn(const StereoFrame& prev, const StereoFrame& curr, const Eigen::Isometry3d& T_curr_prev,
             const FrameContext& context);

  /// The points of the previous frame by which a camera that moves seems to be stationary: they
  /// rest and lie before a scene that agrees on another motion. Looked for only if tracking failed,
  /// or found the camera stationary and much of the scene not; else, and if there are none, empty.
  std::vector<int> findBeforeScene(const StereoFrame& prev, const StereoFrame& curr,
                                   const TrackingResult& tracked,
                                   const FrameContext& context) const;

  /// Features are taken to rest where these points of a frame are, until motions tell otherwise.
  void add(const StereoFrame& frame, const std::vector<int>& points);

  /// After a frame without a motion, `dt_s` after the one before. Where this lasts, what rests may
  /// be the scene: all is forgotten.
  void addLost(double dt_s);

  auto state() {
    auto& [last_px, cells, lost_s] = *this;
    return std::tie(last_px, cells, lost_s);
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

  static constexpr int kCellSize_px = 16;

  static void count(bool rests, Counts* counts);
  Sums around(const Eigen::Vector2f& pixel) const;
  bool rests(const Eigen::Vector2f& pixel) const;
  bool rests(const LineSegment& segment) const;
  bool mayRest(const Eigen::Vector2f& pixel) const;

  Eigen::Vector2f last_px_;  // of the image
  CellGrid<Counts> cells_;
  double lost_s_ = 0.0;
};

}  // namespace point_line_odometry
