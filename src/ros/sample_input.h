#pragma once

#include <nav_msgs/Odometry.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <sensor_msgs/Imu.h>

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "point_line_odometry/gyroscope.h"
#include "point_line_odometry/wheel_odometry.h"
#include "ros/bounded_wait.h"
#include "ros/conversions.h"

namespace point_line_odometry {

/// A sample, and the frame of tf whose motion it is.
template <typename Sample>
struct FramedSample {
  std::string frame_id;
  Sample sample;
};

/// Rates and acceleration with the stamp in the header.
FramedSample<ImuSample> toSample(const sensor_msgs::Imu& message);

/// The pose of child_frame_id with the diagonal of the twist's covariance; the twist itself is not
/// used. Throws MessageError if a number of the pose is not finite or the quaternion is no
/// rotation.
FramedSample<OdometrySample> toSample(const nav_msgs::Odometry& message);

/// Messages of a topic with samples, since the start.
struct SampleCounts {
  std::uint64_t received = 0;
  std::uint64_t malformed = 0;  ///< of these: could not be used
  bool alive = false;           ///< one came within the last second of wall time
};

/// A topic with the samples of another sensor. The callback only queues them; the odometry's worker
/// takes them, and waits a bounded time for those until a frame. A source that is silent is not
/// waited for. What is not taken is bounded. Thread-safe.
template <typename Message, typename Sample>
class SampleInput {
 public:
  explicit SampleInput(std::string topic) : topic_(std::move(topic)) {}

  /// Subscribes unless it has.
  void subscribe(ros::NodeHandle nh);

  /// Unsubscribes, and drops what is queued.
  void unsubscribe();

  bool enabled() const;

  /// Hands what has come to `take`, until `complete` is true, the wait is over or nothing comes. To
  /// be called by one thread.
  void takeUntil(const std::function<void(const FramedSample<Sample>&)>& take,
                 const std::function<bool()>& complete);

  /// For tests without a node: as if it had subscribed, and as if the message had come.
  void enable();
  void add(const Message& message);

  SampleCounts counts() const;

 private:
  bool isAliveLocked() const;

  const std::string topic_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<FramedSample<Sample>> waiting_;
  SampleCounts counts_;           // but for `alive`
  std::optional<double> last_s_;  // wall time
  bool enabled_ = false;
  BoundedWait wait_;  // of the thread that takes
  ros::Subscriber subscriber_;
};

using ImuInput = SampleInput<sensor_msgs::Imu, ImuSample>;
using WheelInput = SampleInput<nav_msgs::Odometry, OdometrySample>;

}  // namespace point_line_odometry
