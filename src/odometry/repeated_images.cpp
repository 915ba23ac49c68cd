#include "odometry/repeated_images.h"

#include <algorithm>
#include <cmath>

#include "common/same_image.h"
#include "motion/prior_factor.h"

namespace point_line_odometry {
namespace {

constexpr int kNoisyFrames = 10;  // a codec has some without noise among as many
constexpr double kMostPixels = 0.5;

// A buffer is handed out again once or twice: without noise, what rests in the images for longer
// than this many times the interval between frames is stationary, as simulated robots are at once.
constexpr double kMostIntervals = 2.5;

// How fast a robot brakes [m/s^2], [rad/s^2], and the noise of its velocity in addition.
constexpr double kBraking = 3.0;
constexpr double kAngularBraking = 4.0;
constexpr double kNoiseSigmas = 3.0;

// Standard deviation of what the covariance of a stationary camera's prior leaves out, along each
// axis [m/s], [rad/s].
constexpr double kRateError = 0.05;

bool mostlyDiffer(const cv::Mat& a, const cv::Mat& b) {
  return a.size() != b.size() ||
         cv::countNonZero(a != b) > kMostPixels * static_cast<double>(a.total());
}

/// Other light or exposure changes most pixels to the same side.
bool differByNoise(const cv::Mat& a, const cv::Mat& b) {
  constexpr double kMostToOneSide = 0.65;
  if (!mostlyDiffer(a, b)) return false;
  const double brighter = cv::countNonZero(a > b);
  const double darker = cv::countNonZero(a < b);
  return std::max(brighter, darker) <= kMostToOneSide * (brighter + darker);
}

bool mayHaveStopped(double dt_s, const CameraVelocity& velocity) {
  const auto may = [&](double braking, int first) {
    const double sigma = std::sqrt(velocity.covariance.diagonal().segment<3>(first).sum());
    return velocity.value.segment<3>(first).norm() <= braking * dt_s + kNoiseSigmas * sigma;
  };
  return may(kBraking, 0) && may(kAngularBraking, 3);
}

bool agreesWithStandstill(const MotionPrior& prior, double dt_s) {
  const Matrix6d covariance = std::pow(kRateError * dt_s, 2) * Matrix6d::Identity();
  return PriorFactor::agrees(
      PriorFactor::compare(prior, Eigen::Isometry3d::Identity(), covariance));
}

}  // namespace

bool RepeatedImages::cameraHasNoise() const { return noisy_frames_ >= kNoisyFrames; }

bool RepeatedImages::areIn(const StereoImages& images, const FrameIntervals& intervals,
                           const std::optional<CameraVelocity>& velocity,
                           const MotionPrior* prior) const {
  if (left_.empty()) return false;
  const bool left = isSameImage(images.left, left_);
  const bool right = isSameImage(images.right, right_);
  if (!left && !right) return false;
  if (cameraHasNoise()) return true;
  const double dt_s = intervals.between(stamp_ns_, images.stamp_ns);
  const bool known = velocity && velocity->is_current && velocity->stamp_ns == stamp_ns_;
  const bool other_differs = left != right && (left ? mostlyDiffer(images.right, right_)
                                                    : mostlyDiffer(images.left, left_));
  const double most_s = kMostIntervals * intervals.usual();
  const bool moves_by_prior = prior != nullptr && !agreesWithStandstill(*prior, dt_s);
  if (other_differs)
    return moves_by_prior || !known || !mayHaveStopped(std::min(dt_s, most_s), *velocity);
  if (believed_ || dt_s > most_s) return false;
  if (moves_by_prior) return true;
  return known && velocity->measured_over_s <= most_s && !mayHaveStopped(dt_s, *velocity);
}

void RepeatedImages::learn(const StereoImages& curr, bool stationary) {
  const bool again = believed_;
  believed_ = isSameImage(curr.left, left_) && isSameImage(curr.right, right_);
  if (cameraHasNoise() || (believed_ && !again)) return;
  noisy_frames_ = stationary && differByNoise(curr.left, left_) ? noisy_frames_ + 1 : 0;
}

}  // namespace point_line_odometry
