#include "world/imu.h"

#include <cmath>
#include <utility>

#include "geometry/se3.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double kGravity = 9.81;  // [m/s^2]

Vector3d gaussianVector(double deviation, Random* random) {
  Vector3d v;
  for (int i = 0; i < 3; ++i) v[i] = deviation * random->gaussian();
  return v;
}

Vector3d uniformVector(double most, Random* random) {
  Vector3d v;
  for (int i = 0; i < 3; ++i) v[i] = random->uniform(-most, most);
  return v;
}

}  // namespace

ImuSampler::ImuSampler(const ImuModel& model, double begin_s,
                       std::function<Isometry3d(double)> T_world_imu, std::uint32_t seed)
    : model_(model),
      begin_s_(begin_s),
      T_world_imu_(std::move(T_world_imu)),
      random_(seed),
      gyroscope_bias_(uniformVector(model.first_gyroscope_bias, &random_)),
      accelerometer_bias_(uniformVector(model.first_accelerometer_bias, &random_)) {}

ImuSample ImuSampler::next() {
  const double step_s = 1.0 / model_.rate_hz;
  const double per_sample = std::sqrt(model_.rate_hz);  // of a noise density
  const double per_step = std::sqrt(step_s);            // of a random walk
  const double time_s = begin_s_ + static_cast<double>(count_++) * step_s;
  const Isometry3d before = T_world_imu_(time_s - 0.5 * step_s);
  const Isometry3d now = T_world_imu_(time_s);
  const Isometry3d after = T_world_imu_(time_s + 0.5 * step_s);
  const Vector3d acceleration =
      (after.translation() - 2.0 * now.translation() + before.translation()) /
      (0.25 * step_s * step_s);
  ImuSample sample;
  sample.stamp_ns = std::llround(1e9 * (time_s + model_.time_offset_s));
  sample.angular_velocity = logSO3(before.linear().transpose() * after.linear()) / step_s +
                            gyroscope_bias_ +
                            gaussianVector(model_.gyroscope_noise * per_sample, &random_);
  sample.acceleration = now.linear().transpose() * (acceleration + kGravity * Vector3d::UnitZ()) +
                        accelerometer_bias_ +
                        gaussianVector(model_.accelerometer_noise * per_sample, &random_);
  gyroscope_bias_ += gaussianVector(model_.gyroscope_random_walk * per_step, &random_);
  accelerometer_bias_ += gaussianVector(model_.accelerometer_random_walk * per_step, &random_);
  return sample;
}

}  // namespace point_line_odometry::world
