#pragma once

/// \file
/// The flow of points of a static scene between two frames, as a rigid motion of a camera gives it
/// whose rows are exposed one after the other. Lengths are in baselines.

#include <Eigen/Core>
#include <vector>

#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// How the homogeneous coordinates (X, Y, Z, W) of a static point change while a camera moves:
/// d(X, Y, Z)/dt = W velocity + rotation x (X, Y, Z).
struct Twist {
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // [baselines / s]
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();  // [rad / s]

  Eigen::Vector3d at(const Eigen::Vector3d& xyz, double w) const {
    return w * velocity + rotation.cross(xyz);
  }
};

/// A point in a frame and the next one. Rows are those of the raw image, from -0.5 (the first) to
/// 0.5 (the last): the time of a row after the middle one is this share of the read-out.
struct Flow {
  Eigen::Vector2d from_px;
  Eigen::Vector2d to_px;
  Eigen::Vector3d ray;         // of from_px: (X, Y, 1)
  double inverse_depth = 0.0;  // [1 / baselines]
  double from_row = 0.0;
  double to_row = 0.0;
  bool inlier = true;  // agrees with the motion
};

/// Two consecutive frames, and the camera's motion from the first one to the second.
struct FlowStep {
  std::vector<Flow> flows;
  double period_s = 0.0;
  bool known = false;  // the motion is
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d t = Eigen::Vector3d::Zero();
  Twist first;   // the velocity at the first frame
  Twist second;  // ... at the second one

  static constexpr int kFewestInliers = 40;

  /// Where the point of a flow is in the camera as its row in the second frame is exposed.
  Eigen::Vector3d predict(const Flow& flow, double read_out_s) const;

  /// Its derivative by the read-out time.
  Eigen::Vector3d byReadOut(const Flow& flow) const;

  /// From the first frame to the second one.
  Twist meanTwist() const;
};

/// Jacobian of the left pixel by the point.
Eigen::Matrix<double, 2, 3> projectionJacobian(const StereoCamera& camera,
                                               const Eigen::Vector3d& xyz);

/// Jacobian of the left pixel by a small motion (translation, rotation) after the step's.
Eigen::Matrix<double, 2, 6> motionJacobian(const StereoCamera& camera, const Flow& flow,
                                           const Eigen::Vector3d& xyz);

/// Fits the motion of a step to its flows, given the velocities and the read-out time, and tells
/// which of them are inliers; `known` if there are enough.
void fitMotion(const StereoCamera& camera, double read_out_s, FlowStep* step);

}  // namespace point_line_odometry
