#pragma once

/// \file
/// The flow of points of a static scene between two frames, as a rigid motion of the camera gives
/// it. Lengths are in baselines.

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "matching/followed_frame.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

using Matrix26d = Eigen::Matrix<double, 2, 6>;

/// How the coordinates of a point (X, Y, Z, 1 / depth) of a static scene change while a camera
/// moves: dp/dt = velocity / depth + rotation x p.
struct Twist {
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // [baselines / s]
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();  // [rad / s]

  Eigen::Vector3d at(const Eigen::Vector3d& p, double inverse_depth) const {
    return inverse_depth * velocity + rotation.cross(p);
  }
};

/// A point in a frame and the next one.
struct Flow {
  Eigen::Vector3d ray;         // (X, Y, 1) in the first one
  double inverse_depth = 0.0;  // [1 / baselines]
  Eigen::Vector2d from_px;
  Eigen::Vector2d to_px;
  std::size_t half = 0;  // of the points, 0 or 1
};

/// From a frame to the next one; translation in baselines.
struct FrameMotion {
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d t = Eigen::Vector3d::Zero();

  Eigen::Vector3d apply(const Flow& flow) const { return R * flow.ray + flow.inverse_depth * t; }

  /// The mean velocity.
  Twist twist(double period_s) const;
};

/// Two consecutive frames.
struct FlowStep {
  std::vector<Flow> flows;
  FrameMotion motion;
  std::array<FrameMotion, 2> of_halves;  // from one half of the points each
  double period_s = 0.0;
  bool known = false;  // the motion is

  static constexpr std::size_t kFewestPoints = 40;
};

/// Jacobian of the pixel by the point.
Eigen::Matrix<double, 2, 3> projectionJacobian(const StereoCamera& camera,
                                               const Eigen::Vector3d& p);

/// Jacobian of the pixel by a small motion after the one that is known.
Matrix26d motionJacobian(const StereoCamera& camera, const Flow& flow, const Eigen::Vector3d& p);

/// Three standard deviations of values whose median amount is this; more are outliers.
double outlierCut(std::vector<double> deviations);

/// The points that were followed to the next frame and a rigid motion that fits them, as known from
/// all of them and from each half; others are dropped. Not known if too few are left.
FlowStep fitFlowStep(const FollowedFrame& frame, const StereoCamera& camera);

}  // namespace point_line_odometry
