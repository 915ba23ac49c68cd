#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <string>

#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/stereo_correction.h"
#include "point_line_odometry/tilt_correction.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// The pipeline: one call per stereo frame. Deterministic; not thread-safe; no ROS.
class StereoOdometry {
 public:
  /// Throws std::invalid_argument if the camera or a parameter is out of its range (all bad ones
  /// are named).
  StereoOdometry(const StereoCamera& camera, const Parameters& parameters);
  ~StereoOdometry();
  /// What was moved from can only be assigned to or destroyed.
  StereoOdometry(StereoOdometry&&) noexcept;
  /// \copydoc StereoOdometry(StereoOdometry&&)
  StereoOdometry& operator=(StereoOdometry&&) noexcept;

  /// Estimates the motion since the last frame and integrates it. Bad data and internal errors give
  /// a state and a reason in the result, never an exception.
  /// \param prior what is known of the motion since the last accepted frame; null: nothing.
  FrameResult process(const StereoImages& images, const MotionPrior* prior = nullptr);

  /// Turns the pose of the last frame, and the map with it, about the camera; the published pose
  /// follows gradually, once a stationary camera moves. Returns false, and changes nothing, if a
  /// number cannot be used.
  bool correctTilt(const TiltCorrection& correction);

  /// Discards all state; the next frame is the first one, and has this pose. Throws
  /// std::invalid_argument if it is not finite.
  void reset(const Eigen::Isometry3d& T_odom_camera = Eigen::Isometry3d::Identity());

  /// Tracking and map start again at this pose of the next frame, which may have any stamp: where a
  /// clock was set back, or the camera was moved on its robot. Other than by reset() what has been
  /// learnt of the images is kept, and so is the covariance; it grows by the motion between two
  /// frames, which is missing. Throws likewise.
  void continueAt(const Eigen::Isometry3d& T_odom_camera);

  /// Takes another calibration: tracking and map start again. The pose goes on as in a frame
  /// without a motion.
  void setCamera(const StereoCamera& camera);

  /// Takes other parameters from the next frame on; tracking continues, landmarks are kept unless
  /// `window` or `local_map` changes. With another size of images (`tracking/max_megapixels`),
  /// `points/descriptor`, `points/scale_factor` or `tracking/rolling_shutter_ms` tracking and map
  /// start again, as by setCamera(). Throws like the constructor, and changes nothing then.
  void setParameters(const Parameters& parameters);

  /// The state between frames, serialized: after a hundred frames of KITTI 8 MB in 2 ms. Waits for
  /// the window's bundle adjustment, for which the next frame would wait.
  std::string saveState();

  /// Continues from where saveState() was called: with the same camera and parameters, the same
  /// images give the same bits, by the same version of this library on the same kind of computer.
  /// Throws std::invalid_argument, and changes nothing then, if the bytes are not complete or of
  /// another layout; numbers are not checked beyond that.
  void restoreState(const std::string& bytes);

  /// The calibration in force.
  const StereoCamera& camera() const;
  /// The parameters in force.
  const Parameters& parameters() const;

  /// The detector of line segments in use: that of lines/detector, or its fallback.
  LineDetectorKind lineDetector() const;

  /// Displacement of the right image against its calibration, as estimated so far; in pixels of the
  /// images as they are processed (tracking/max_megapixels).
  const StereoCorrection& correction() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace point_line_odometry
