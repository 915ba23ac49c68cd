#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace point_line_odometry::world {

/// Speeds, accelerations and sway of a camera.
struct MotionStyle {
  double cruise_m_s = 1.0;                             ///< speed on straight parts
  double lateral_m_s2 = 2.0;                           ///< largest lateral acceleration, in curves
  double longitudinal_m_s2 = 1.0;                      ///< largest acceleration along the curve
  double turn_rad_s = 1e9;                             ///< largest yaw rate
  Eigen::Vector3d sway_m = Eigen::Vector3d::Zero();    ///< forward, left, up
  Eigen::Vector3d sway_rad = Eigen::Vector3d::Zero();  ///< roll, pitch, yaw
  double sway_hz = 0.5;                                ///< lowest frequency of the sway
  bool follows_slope = false;  ///< pitches with the slope, as a car does; else it stays level
};

/// A closed smooth curve that a camera travels again and again: position, heading and speed are
/// continuous. The world's z is up; the camera looks along the curve.
class CameraTrajectory {
 public:
  CameraTrajectory() = default;

  /// \param corners of a closed polygon [m]; they are rounded off by arcs of about `radius_m`.
  CameraTrajectory(const std::vector<Eigen::Vector3d>& corners, double radius_m,
                   const MotionStyle& style, std::uint32_t seed);

  double length_m() const { return length_m_; }

  /// Arc length [m] after a time, at `speed` times the speed of the style.
  double travelled_m(double time_s, double speed) const;

  /// Pose at an arc length: x along the curve, y level to the left; z up, or normal to the slope
  /// with `follows_slope`.
  Eigen::Isometry3d at(double arc_m) const;

  /// Pose of a camera (x right, y down, z forward) at a time; `sway` scales the style's.
  Eigen::Isometry3d cameraPose(double time_s, double speed, double sway) const;

 private:
  struct Knot {
    double arc_m = 0.0;
    double time_s = 0.0;
    double speed_m_s = 0.0;
  };
  struct SplinePoint {
    Eigen::Vector3d position;
    Eigen::Vector3d velocity;  // derivatives by the spline's parameter
    Eigen::Vector3d acceleration;
  };

  SplinePoint evaluate(double parameter) const;
  double parameterAt(double arc_m) const;
  void measure();
  void planSpeed();

  MotionStyle style_;
  std::vector<Eigen::Vector3d> control_;  // of a closed uniform cubic B-spline
  std::vector<Knot> knots_;               // at equal steps of the spline's parameter, one lap
  std::vector<double> phases_;
  double length_m_ = 0.0;
  double lap_s_ = 0.0;
};

}  // namespace point_line_odometry::world
