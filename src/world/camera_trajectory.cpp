#include "world/camera_trajectory.h"

#include <algorithm>
#include <cmath>

#include "geometry/camera_axes.h"
#include "world/random.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Vector3d;

constexpr int kStepsPerControl = 12;
constexpr int kWaves = 3;  // number of sines in each coordinate of the sway

/// Points of a closed polygon with rounded corners, about equally spaced.
std::vector<Vector3d> roundOff(const std::vector<Vector3d>& corners, double radius_m,
                               double spacing_m) {
  std::vector<Vector3d> fine;
  const std::size_t n = corners.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Vector3d& corner = corners[i];
    const Vector3d to_prev = (corners[(i + n - 1) % n] - corner);
    const Vector3d to_next = (corners[(i + 1) % n] - corner);
    const double cut = std::min({radius_m, 0.5 * to_prev.norm(), 0.5 * to_next.norm()});
    const Vector3d begin = corner + cut * to_prev.normalized();
    const Vector3d end = corner + cut * to_next.normalized();
    constexpr int kParts = 64;
    for (int k = 0; k <= kParts; ++k) {  // a quadratic Bezier curve, close to an arc
      const double s = static_cast<double>(k) / kParts;
      fine.emplace_back((1.0 - s) * (1.0 - s) * begin + 2.0 * s * (1.0 - s) * corner + s * s * end);
    }
  }
  double length = 0.0;
  for (std::size_t i = 0; i < fine.size(); ++i) {
    length += (fine[(i + 1) % fine.size()] - fine[i]).norm();
  }
  const auto count = static_cast<std::size_t>(std::max(8.0, std::round(length / spacing_m)));
  std::vector<Vector3d> points;
  double passed = 0.0;
  for (std::size_t i = 0; i < fine.size() && points.size() < count; ++i) {
    const Vector3d& from = fine[i];
    const Vector3d& to = fine[(i + 1) % fine.size()];
    const double step = (to - from).norm();
    while (points.size() < count) {
      const double wanted =
          length * static_cast<double>(points.size()) / static_cast<double>(count);
      if (wanted > passed + step || step <= 0.0) break;
      points.emplace_back(from + (to - from) * ((wanted - passed) / step));
    }
    passed += step;
  }
  return points;
}

/// Rotation by angles about x, y and z of a body (x forward, y left, z up).
Eigen::Quaterniond fromRollPitchYaw(const Vector3d& angles) {
  return Eigen::AngleAxisd(angles.z(), Vector3d::UnitZ()) *
         Eigen::AngleAxisd(angles.y(), Vector3d::UnitY()) *
         Eigen::AngleAxisd(angles.x(), Vector3d::UnitX());
}

}  // namespace

CameraTrajectory::CameraTrajectory(const std::vector<Vector3d>& corners, double radius_m,
                                   const MotionStyle& style, std::uint32_t seed)
    : style_(style) {
  // The trajectory begins in the middle of the first edge.
  std::vector<Vector3d> polygon = corners;
  polygon.insert(polygon.begin() + 1, 0.5 * (corners[0] + corners[1]));
  std::rotate(polygon.begin(), polygon.begin() + 1, polygon.end());
  control_ = roundOff(polygon, radius_m, 0.3 * radius_m);
  Random random(seed);
  for (int i = 0; i < 6 * kWaves; ++i) phases_.push_back(random.uniform(0.0, 2.0 * kPi));
  measure();
  planSpeed();
}

CameraTrajectory::SplinePoint CameraTrajectory::evaluate(double parameter) const {
  const auto n = static_cast<double>(control_.size());
  parameter -= n * std::floor(parameter / n);
  const auto first = std::min(static_cast<std::size_t>(parameter), control_.size() - 1);
  const double t = parameter - static_cast<double>(first);
  const auto control = [&](std::size_t i) { return control_[(first + i) % control_.size()]; };
  const Vector3d p0 = control(0);
  const Vector3d p1 = control(1);
  const Vector3d p2 = control(2);
  const Vector3d p3 = control(3);
  const double s = 1.0 - t;
  SplinePoint point;
  point.position = (s * s * s * p0 + (3.0 * t * t * t - 6.0 * t * t + 4.0) * p1 +
                    (3.0 * s * s * s - 6.0 * s * s + 4.0) * p2 + t * t * t * p3) /
                   6.0;
  point.velocity = 0.5 * (-s * s * p0 + (3.0 * t * t - 4.0 * t) * p1 -
                          (3.0 * s * s - 4.0 * s) * p2 + t * t * p3);
  point.acceleration = s * p0 + (3.0 * t - 2.0) * p1 + (3.0 * s - 2.0) * p2 + t * p3;
  return point;
}

/// Arc lengths of the knots, by Simpson's rule.
void CameraTrajectory::measure() {
  const std::size_t steps = control_.size() * kStepsPerControl;
  constexpr double kStep = 1.0 / kStepsPerControl;
  knots_.resize(steps + 1);
  const auto speed = [this](double parameter) { return evaluate(parameter).velocity.norm(); };
  for (std::size_t i = 0; i < steps; ++i) {
    const double from = static_cast<double>(i) * kStep;
    const double mean = (speed(from) + 4.0 * speed(from + 0.5 * kStep) + speed(from + kStep)) / 6.0;
    knots_[i + 1].arc_m = knots_[i].arc_m + mean * kStep;
  }
  length_m_ = knots_.back().arc_m;
}

/// Speeds of the knots: the cruising speed, less in curves, with bounded acceleration.
void CameraTrajectory::planSpeed() {
  const std::size_t steps = knots_.size() - 1;
  for (std::size_t i = 0; i <= steps; ++i) {
    const SplinePoint point = evaluate(static_cast<double>(i % steps) / kStepsPerControl);
    const double curvature =
        point.velocity.cross(point.acceleration).norm() / std::pow(point.velocity.norm(), 3);
    const double bend = std::max(curvature, 1e-9);
    knots_[i].speed_m_s = std::min(
        {style_.cruise_m_s, std::sqrt(style_.lateral_m_s2 / bend), style_.turn_rad_s / bend});
  }
  const auto limit = [this](const Knot& from, Knot* to, double distance) {
    const double most = from.speed_m_s * from.speed_m_s + 2.0 * style_.longitudinal_m_s2 * distance;
    to->speed_m_s = std::min(to->speed_m_s, std::sqrt(most));
  };
  for (int lap = 0; lap < 2; ++lap) {
    for (std::size_t i = 0; i < steps; ++i) {
      limit(knots_[i], &knots_[i + 1], knots_[i + 1].arc_m - knots_[i].arc_m);
    }
    knots_[0].speed_m_s = std::min(knots_[0].speed_m_s, knots_[steps].speed_m_s);
    for (std::size_t i = steps; i > 0; --i) {
      limit(knots_[i], &knots_[i - 1], knots_[i].arc_m - knots_[i - 1].arc_m);
    }
    knots_[steps].speed_m_s = std::min(knots_[0].speed_m_s, knots_[steps].speed_m_s);
  }
  for (std::size_t i = 0; i < steps; ++i) {
    const double mean = 0.5 * (knots_[i].speed_m_s + knots_[i + 1].speed_m_s);
    knots_[i + 1].time_s = knots_[i].time_s + (knots_[i + 1].arc_m - knots_[i].arc_m) / mean;
  }
  lap_s_ = knots_.back().time_s;
}

double CameraTrajectory::travelled_m(double time_s, double speed) const {
  const double laps = std::floor(time_s * speed / lap_s_);
  const double time = time_s * speed - laps * lap_s_;
  const auto after = std::upper_bound(knots_.begin() + 1, knots_.end() - 1, time,
                                      [](double t, const Knot& knot) { return t < knot.time_s; });
  const Knot& from = *(after - 1);
  const double acceleration = (after->speed_m_s - from.speed_m_s) / (after->time_s - from.time_s);
  const double since = time - from.time_s;
  return laps * length_m_ + from.arc_m + from.speed_m_s * since +
         0.5 * acceleration * since * since;
}

double CameraTrajectory::parameterAt(double arc_m) const {
  const double arc = arc_m - length_m_ * std::floor(arc_m / length_m_);
  const auto after = std::upper_bound(knots_.begin() + 1, knots_.end() - 1, arc,
                                      [](double a, const Knot& knot) { return a < knot.arc_m; });
  const Knot& from = *(after - 1);
  const double share = (arc - from.arc_m) / (after->arc_m - from.arc_m);
  return (static_cast<double>(after - 1 - knots_.begin()) + share) / kStepsPerControl;
}

Eigen::Isometry3d CameraTrajectory::at(double arc_m) const {
  const SplinePoint point = evaluate(parameterAt(arc_m));
  const Vector3d ahead = Vector3d(point.velocity.x(), point.velocity.y(), 0.0).normalized();
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear().col(0) = ahead;
  pose.linear().col(1) = Vector3d(-ahead.y(), ahead.x(), 0.0);
  pose.linear().col(2) = Vector3d::UnitZ();
  if (style_.follows_slope) {
    pose.linear().col(0) = point.velocity.normalized();
    pose.linear().col(2) = pose.linear().col(0).cross(pose.linear().col(1));
  }
  pose.translation() = point.position;
  return pose;
}

Eigen::Isometry3d CameraTrajectory::cameraPose(double time_s, double speed, double sway) const {
  // Frequencies without a common period.
  constexpr double kRatios[kWaves] = {1.0, 1.618, 2.414};
  constexpr double kShares[kWaves] = {0.6, 0.3, 0.15};
  Eigen::Matrix<double, 6, 1> wave = Eigen::Matrix<double, 6, 1>::Zero();
  for (int i = 0; i < 6; ++i) {
    for (int k = 0; k < kWaves; ++k) {
      const double frequency = style_.sway_hz * kRatios[k] * (1.0 + 0.07 * i);
      wave(i) += kShares[k] * std::sin(2.0 * kPi * frequency * time_s +
                                       phases_[static_cast<std::size_t>(kWaves * i + k)]);
    }
  }
  const Vector3d offset = sway * style_.sway_m.cwiseProduct(wave.head<3>());
  const Vector3d angles = sway * style_.sway_rad.cwiseProduct(wave.tail<3>());
  Eigen::Isometry3d pose = at(travelled_m(time_s, speed));
  pose.translation() += pose.linear() * offset;
  pose.linear() = pose.linear() * fromRollPitchYaw(angles).toRotationMatrix() * cameraAxesInBody();
  return pose;
}

}  // namespace point_line_odometry::world
