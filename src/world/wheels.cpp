#include "world/wheels.h"

#include <cmath>
#include <utility>

#include "geometry/se3.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double kUnknown = 1e6;  // variance of axes that wheels do not measure, as in ROS

/// x, y and yaw of a motion.
Vector3d planar(const Isometry3d& motion) {
  return {motion.translation().x(), motion.translation().y(), logSO3(motion.linear()).z()};
}

}  // namespace

WheelSampler::WheelSampler(const WheelModel& model, double begin_s,
                           std::function<Isometry3d(double)> T_world_body, std::uint32_t seed)
    : model_(model),
      begin_s_(begin_s),
      T_world_body_(std::move(T_world_body)),
      random_(seed),
      T_world_last_(T_world_body_(begin_s)) {}

/// Once in each period, at a random time.
bool WheelSampler::slips(double time_s) {
  const auto period = static_cast<std::int64_t>(std::floor(time_s / model_.slip_period_s));
  if (period != slip_period_) {
    slip_period_ = period;
    slip_begin_s_ = static_cast<double>(period) * model_.slip_period_s +
                    random_.uniform(0.0, model_.slip_period_s - model_.slip_s);
  }
  return time_s >= slip_begin_s_ && time_s < slip_begin_s_ + model_.slip_s;
}

OdometrySample WheelSampler::next() {
  const double step_s = 1.0 / model_.rate_hz;
  const double time_s = begin_s_ + static_cast<double>(count_) * step_s;
  const Isometry3d T_world_body = T_world_body_(time_s);
  Vector3d step = planar(T_world_last_.inverse() * T_world_body);
  T_world_last_ = T_world_body;
  step *= 1.0 + model_.scale_error + (slips(time_s) ? model_.slip : 0.0);
  for (int i = 0; i < 3 && count_ > 0; ++i) {
    const double noise = i < 2 ? model_.speed_noise : model_.turn_noise;
    step[i] += noise * step_s * random_.gaussian();
  }
  // The body turns while it moves: its mean axes are those of half the turn.
  const double yaw = pose_.z() + 0.5 * step.z();
  pose_ += Vector3d(std::cos(yaw) * step.x() - std::sin(yaw) * step.y(),
                    std::sin(yaw) * step.x() + std::cos(yaw) * step.y(), step.z());
  ++count_;
  OdometrySample sample;
  sample.stamp_ns = std::llround(1e9 * time_s);
  sample.T_odom_body.linear() = expSO3(pose_.z() * Vector3d::UnitZ());
  sample.T_odom_body.translation() << pose_.x(), pose_.y(), 0.0;
  sample.twist_variance << std::pow(model_.speed_noise, 2), std::pow(model_.speed_noise, 2),
      kUnknown, kUnknown, kUnknown, std::pow(model_.turn_noise, 2);
  return sample;
}

}  // namespace point_line_odometry::world
