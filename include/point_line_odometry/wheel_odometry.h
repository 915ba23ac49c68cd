#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/prior_trust.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// One pose by wheels, or by any other source that does not use the images.
struct OdometrySample {
  std::int64_t stamp_ns = 0;  ///< by the clock of the images
  /// Pose of the body in the odometry's own fixed frame.
  Eigen::Isometry3d T_odom_body = Eigen::Isometry3d::Identity();
  /// Variances of the velocity along and about the axes of the body [m^2/s^2, rad^2/s^2]. Zero,
  /// negative or NaN: not given; of 1000 and more: the axis is not measured.
  Vector6d twist_variance = Vector6d::Zero();
};

/// Samples that were not used, since the start.
struct OdometryFaults {
  std::size_t doubled = 0;     ///< with the stamp of another one
  std::size_t late = 0;        ///< older than all that are kept
  std::size_t not_finite = 0;  ///< NaN, infinite, or no rotation
};

/// Motion priors of the camera from the odometry of the robot's wheels: the difference of its poses
/// at the stamps of two frames. Its error is that of the velocity, constant over the interval, and
/// a share of the distance and of the turn (slip). It is compared with the images, and suspended
/// while too often they disagree. What a frame gets depends on the stamps of samples and frames,
/// not on the order in which samples arrive. Memory is bounded. Deterministic; not thread-safe.
class WheelOdometry {
 public:
  /// \param T_body_camera pose of the rectified left camera in the body whose poses are given.
  WheelOdometry(const Parameters& parameters, const Eigen::Isometry3d& T_body_camera);

  /// Takes a sample, in any order.
  void add(const OdometrySample& sample);

  /// True if a sample is known that ends the interval until a frame: later ones do not change its
  /// prior.
  bool covers(std::int64_t frame_ns) const;

  /// The motion between the stamps of two frames. Nothing if samples are missing around one of
  /// them, the poses jump in between, or it is not trusted. A source without variances gives x, y
  /// and yaw, and z, roll and pitch with the large deviations of what stands on the ground; with
  /// planar/enabled these are left to that.
  std::optional<MotionPrior> between(std::int64_t from_ns, std::int64_t to_ns) const;

  /// Compares its motion with that which the images of a frame gave.
  void update(const FrameResult& result);

  /// False while it is suspended, since too many of its motions disagree with the images.
  bool isTrusted() const { return trust_.isTrusted(); }

  /// Discards the samples, for a clock or a body that changed; whether it is trusted is kept.
  void clear();

  /// Takes other parameters; samples are kept.
  void setParameters(const Parameters& parameters);

  const OdometryFaults& faults() const { return faults_; }  ///< of the samples

 private:
  std::optional<Eigen::Isometry3d> poseAt(std::int64_t stamp_ns, double* gap_s) const;
  bool jumps(std::int64_t from_ns, std::int64_t to_ns) const;
  Vector6d meanVariance(std::int64_t from_ns, std::int64_t to_ns) const;
  std::optional<MotionPrior> measure(std::int64_t from_ns, std::int64_t to_ns) const;
  Vector6d deviations(const Eigen::Isometry3d& motion, std::int64_t from_ns, std::int64_t to_ns,
                      double gap_s) const;

  Parameters parameters_;
  Eigen::Isometry3d T_body_camera_;
  std::deque<OdometrySample> samples_;      // by stamp
  std::optional<std::int64_t> updated_ns_;  // stamp of the last frame
  PriorTrust trust_;
  OdometryFaults faults_;
};

/// Of a body on a flat floor: it does not move along its z and does not roll or pitch, with the
/// deviations of the parameters, which grow with the root of the time.
MotionPrior planarPrior(const PlanarParameters& parameters, const Eigen::Isometry3d& T_body_camera,
                        std::int64_t from_ns, std::int64_t to_ns);

/// The flat floor as a source of motion priors, compared with the images and suspended by itself,
/// as wheels are: on thresholds and ramps the other sources are still used.
class PlanarFloor {
 public:
  /// \param T_body_camera pose of the rectified left camera in the body that is on the floor.
  PlanarFloor(const PlanarParameters& parameters, const Eigen::Isometry3d& T_body_camera)
      : parameters_(parameters), T_body_camera_(T_body_camera) {}

  /// planarPrior(); nothing while it is not trusted.
  std::optional<MotionPrior> between(std::int64_t from_ns, std::int64_t to_ns) const;

  /// Compares it with the motion which the images of a frame gave.
  void update(const FrameResult& result);

  /// False while it is suspended, since too many motions disagree with it.
  bool isTrusted() const { return trust_.isTrusted(); }

  /// Takes other parameters.
  void setParameters(const PlanarParameters& parameters) { parameters_ = parameters; }

 private:
  PlanarParameters parameters_;
  Eigen::Isometry3d T_body_camera_;
  PriorTrust trust_;
};

}  // namespace point_line_odometry
