#include "odometry/repeated_images.h"

#include <cmath>

#include "common/same_image.h"
#include "motion/prior_factor.h"

namespace point_line_odometry {
namespace {

// A buffer is handed out again once or twice: what rests in the images for longer than this many
// times the interval between frames has stopped, as simulated robots do without braking.
constexpr double kMostIntervals = 2.5;

// How fast a robot brakes. [m/s^2], [rad/s^2]
constexpr double kBraking = 1.0;
constexpr double kAngularBraking = 4.0;
constexpr double kNoiseSigmas = 3.0;  // of the velocity, in addition

// Standard deviation of what the covariance of a stationary camera's prior leaves out, along each
// axis. [m/s], [rad/s]
constexpr double kRateError = 0.05;

bool mayHaveStopped(double dt_s, const CameraVelocity& velocity) {
  const auto may = [&](double braking, int first) {
    const double sigma = std::sqrt(velocity.covariance.diagonal().segment<3>(first).sum());
    return velocity.value.segment<3>(first).norm() <= braking * dt_s + kNoiseSigmas * sigma;
  };
  return may(kBraking, 0) && may(kAngularBraking, 3);
}

/// Whether a camera may be where it was at the previous frame, by a prior and its velocity there.
bool mayBeStationary(double dt_s, const std::optional<CameraVelocity>& velocity,
                     const MotionPrior* prior) {
  if (prior != nullptr) {
    const Matrix6d covariance = std::pow(kRateError * dt_s, 2) * Matrix6d::Identity();
    const PriorReport report =
        PriorFactor::compare(*prior, Eigen::Isometry3d::Identity(), covariance);
    if (!PriorFactor::agrees(report)) return false;
    if (knowsTranslation(*prior)) return true;
  }
  return !velocity || mayHaveStopped(dt_s, *velocity);
}

}  // namespace

bool areRepeated(const StereoImages& images, const StereoFrame& previous, const FrameClock& clock,
                 const std::optional<CameraVelocity>& velocity, const MotionPrior* prior) {
  const bool left = isSameImage(images.left, previous.left_image.levels.front());
  const bool right = isSameImage(images.right, previous.right_image);
  if (left != right) return true;
  if (!left) return false;
  const double dt_s = toSeconds(clock.timeOf(images.stamp_ns) - previous.time_ns);
  const double most_s = kMostIntervals * clock.meanInterval();
  const bool usable = velocity && velocity->is_current && velocity->time_ns == previous.time_ns &&
                      velocity->measured_over_s <= most_s && dt_s <= most_s;
  return !mayBeStationary(dt_s, usable ? velocity : std::nullopt, prior);
}

}  // namespace point_line_odometry
