#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <tuple>
#include <vector>

#include "map/local_map.h"
#include "motion/sights.h"
#include "odometry/stage_timer.h"
#include "point_line_odometry/matching.h"
#include "point_line_odometry/motion.h"
#include "point_line_odometry/pose_integrator.h"
#include "point_line_odometry/stereo_odometry.h"
#include "point_line_odometry/thread_pool.h"

namespace point_line_odometry {

/// Frame k-2.
struct EarlierFrame {
  StereoFrame frame;
  Eigen::Isometry3d T_reference_before = Eigen::Isometry3d::Identity();  ///< motion k-2 -> k-1

  auto state() {
    auto& [frame_of_this, T] = *this;
    return std::tie(frame_of_this, T);
  }
};

/// What earlier frames have left to measure a motion with.
struct FrameHistory {
  std::optional<StereoFrame> reference;  ///< frame k-1: the last one that can be matched with
  std::optional<EarlierFrame> before_reference;  ///< frame k-2, kept for the fusion of rotations
  std::optional<LocalMap> map;                   ///< nothing without a window
};

/// What earlier frames and the current one say about the motion since the reference.
struct MotionMeasurement {
  TrackingReason reason = TrackingReason::kNone;  ///< kNone: the motion is measured
  CircularMatches matches;                        ///< (reference, current)
  Correspondences correspondences;
  MotionEstimate direct;  ///< from these alone
  MotionEstimate motion;  ///< the best one: against the map if there is one
  /// The motion does not carry itself: its weak axes are those of the prediction.
  bool weak = false;
  MapSights sights;
  bool relocalized = false;  ///< `motion` comes from the landmarks alone, found by their looks
};

/// Points that were seen before, wherever they are seen now: element i of both lists is one point.
struct KnownPoints {
  std::vector<Eigen::Vector3d> positions;  ///< in the reference's camera frame [m]
  std::vector<StereoDescriptor> descriptors;
};

/// Measures the motion of one frame since the reference: matches it with the reference, with the
/// frame before that if rotations are fused, and with the landmarks of the map.
class MotionMeter {
 public:
  /// All must outlive this. \param history with a reference. \param velocity the last one measured,
  /// for the prediction; nothing if it is not known.
  MotionMeter(const FrameHistory& history, const std::optional<CameraVelocity>& velocity,
              const FrameContext& context, ThreadPool* threads, StageTimes* times)
      : history_(history),
        velocity_(velocity),
        context_(context),
        parameters_(context.parameters),
        threads_(threads),
        times_(times) {}

  MotionMeasurement measure(const StereoFrame& curr) const;

  /// Looks for the camera in the map without any knowledge of its motion: landmarks that look alike
  /// over the whole image, consensus, then the usual estimate against all landmarks. A wrong place
  /// is worse than none: without a motion (reason kTooFewInliers, or too fast) unless much of what
  /// should be in view is found.
  MotionMeasurement relocalize(const StereoFrame& curr) const;

 private:
  /// Where the times of a measurement go.
  struct Stages {
    Stage match;
    Stage estimate;
  };

  MotionPrediction predict(double dt_s) const;
  MotionMeasurement measureDirectly(const StereoFrame& curr,
                                    const MotionPrediction& prediction) const;
  MotionMeasurement measureSince(const StereoFrame& earlier, const StereoFrame& curr,
                                 const MotionPrediction& prediction, const Stages& stages,
                                 ThreadPool* threads) const;
  MotionMeasurement measureNear(const StereoFrame& earlier, const StereoFrame& curr,
                                const MotionPrediction& prediction, const Stages& stages,
                                ThreadPool* threads) const;
  std::optional<Eigen::Isometry3d> searchWidely(const KnownPoints& known,
                                                const StereoFrame& curr) const;
  void measureAgainstMap(const StereoFrame& curr, const MotionPrediction& prediction,
                         MotionMeasurement* measurement) const;
  MotionEstimate estimate(const Correspondences& matches, const Eigen::Isometry3d& T_curr_prev,
                          const StereoFrame& prev, const StereoFrame& curr) const;
  void supportWeakAxes(double dt_s, MotionMeasurement* measurement) const;
  TrackingReason reasonOf(const MotionEstimate& motion, double dt_s) const;

  const FrameHistory& history_;
  const std::optional<CameraVelocity>& velocity_;
  const FrameContext& context_;
  const Parameters& parameters_;
  ThreadPool* threads_;
  StageTimes* times_;
};

}  // namespace point_line_odometry
