#include "ros/tf_guess.h"

#include <tf2/exceptions.h>

#include <chrono>
#include <thread>

#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

constexpr std::chrono::milliseconds kTfPoll{2};

}  // namespace

/// Polls, as tf2's own wait depends on a simulated clock that may stand still.
std::optional<Eigen::Isometry3d> TfGuess::lookUp(const ros::Time& stamp) {
  const auto end = wait_.end();
  while (true) {
    try {
      const auto pose = toIsometry(buffer_.lookupTransform(guess_, base_, stamp).transform);
      wait_.note(true);
      return pose;
    } catch (const tf2::TransformException&) {
      // perhaps not yet there
    } catch (const MessageError&) {
      return std::nullopt;
    }
    if (std::chrono::steady_clock::now() >= end) {
      wait_.note(false);
      return std::nullopt;
    }
    std::this_thread::sleep_for(kTfPoll);
  }
}

}  // namespace point_line_odometry
