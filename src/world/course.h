#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace point_line_odometry::world {

/// How a camera travels and sways.
struct MotionStyle {
  double cruise_m_s = 1.0;         ///< speed where the course is straight
  double lateral_m_s2 = 2.0;       ///< acceleration towards the inside that curves are driven with
  double longitudinal_m_s2 = 1.0;  ///< acceleration along the course
  double turn_rad_s = 1e9;         ///< rate at which curves are turned, at most
  Eigen::Vector3d sway_m = Eigen::Vector3d::Zero();    ///< forward, left, up
  Eigen::Vector3d sway_rad = Eigen::Vector3d::Zero();  ///< roll, pitch, yaw
  double sway_hz = 0.5;        ///< slowest of the frequencies that are mixed
  bool follows_slope = false;  ///< pitches with the course, as a car does; else it stays level
};

/// A closed smooth curve that is travelled round and round: position, heading and speed are
/// continuous. The world's z is up; the camera looks along the curve.
class Course {
 public:
  Course() = default;

  /// \param corners of a closed polygon [m]; they are rounded off by arcs of about `radius_m`.
  Course(const std::vector<Eigen::Vector3d>& corners, double radius_m, const MotionStyle& style,
         std::uint32_t seed);

  double length_m() const { return length_m_; }

  /// Arc length [m] after a time when everything goes `speed` times as fast as the style says.
  double travelled_m(double time_s, double speed) const;

  /// Pose at an arc length: x along the course, y level to the left; z up, or square to the slope
  /// if the style follows it.
  Eigen::Isometry3d at(double arc_m) const;

  /// Pose of a camera (x right, y down, z forward) at a time; `sway` scales the style's.
  Eigen::Isometry3d cameraPose(double time_s, double speed, double sway) const;

 private:
  struct Knot {
    double arc_m = 0.0;
    double time_s = 0.0;
    double speed_m_s = 0.0;
  };
  struct Place {
    Eigen::Vector3d position;
    Eigen::Vector3d velocity;  // by the spline's parameter
    Eigen::Vector3d acceleration;
  };

  Place evaluate(double parameter) const;
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
