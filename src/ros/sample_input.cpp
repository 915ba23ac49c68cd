#include "ros/sample_input.h"

#include <ros/time.h>

#include <chrono>

namespace point_line_odometry {
namespace {

constexpr std::uint32_t kQueueSize = 2000;
constexpr std::size_t kMaxWaiting = 20000;
constexpr double kTimeout_s = 1.0;

}  // namespace

FramedSample<ImuSample> toSample(const sensor_msgs::Imu& message) {
  const auto vector = [](const geometry_msgs::Vector3& v) {
    return Eigen::Vector3d(v.x, v.y, v.z);
  };
  return {withoutLeadingSlash(message.header.frame_id),
          {toNanoseconds(message.header.stamp), vector(message.angular_velocity),
           vector(message.linear_acceleration)}};
}

FramedSample<OdometrySample> toSample(const nav_msgs::Odometry& message) {
  OdometrySample sample;
  sample.stamp_ns = toNanoseconds(message.header.stamp);
  sample.T_odom_body = toIsometry(message.pose.pose);
  for (std::size_t i = 0; i < 6; ++i)
    sample.twist_variance[static_cast<int>(i)] = message.twist.covariance[7 * i];
  return {withoutLeadingSlash(message.child_frame_id), sample};
}

template <typename Message, typename Sample>
void SampleInput<Message, Sample>::subscribe(ros::NodeHandle nh) {
  if (enabled()) return;
  enable();
  const boost::function<void(const boost::shared_ptr<const Message>&)> take =
      [this](const boost::shared_ptr<const Message>& message) { add(*message); };
  subscriber_ = nh.subscribe(topic_, kQueueSize, take, {}, ros::TransportHints().tcpNoDelay());
}

template <typename Message, typename Sample>
void SampleInput<Message, Sample>::unsubscribe() {
  subscriber_.shutdown();
  const std::lock_guard<std::mutex> lock(mutex_);
  enabled_ = false;
  waiting_.clear();
}

template <typename Message, typename Sample>
bool SampleInput<Message, Sample>::enabled() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return enabled_;
}

template <typename Message, typename Sample>
void SampleInput<Message, Sample>::enable() {
  const std::lock_guard<std::mutex> lock(mutex_);
  enabled_ = true;
}

template <typename Message, typename Sample>
void SampleInput<Message, Sample>::add(const Message& message) {
  std::optional<FramedSample<Sample>> sample;
  try {
    sample = toSample(message);
  } catch (const MessageError&) {
    // counted below
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  ++counts_.received;
  last_s_ = ros::WallTime::now().toSec();
  if (!sample) {
    ++counts_.malformed;
    return;
  }
  waiting_.push_back(std::move(*sample));
  if (waiting_.size() > kMaxWaiting) waiting_.pop_front();
  changed_.notify_all();
}

template <typename Message, typename Sample>
void SampleInput<Message, Sample>::takeUntil(
    const std::function<void(const FramedSample<Sample>&)>& take,
    const std::function<bool()>& complete) {
  const auto end = wait_.end();
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    const auto come = std::exchange(waiting_, {});
    lock.unlock();
    for (const FramedSample<Sample>& sample : come) take(sample);
    const bool done = complete();
    lock.lock();
    if (done) wait_.note(true);
    if (done || !enabled_ || !isAliveLocked()) return;
    const bool more = changed_.wait_until(lock, end, [this] { return !waiting_.empty(); });
    if (!more || std::chrono::steady_clock::now() >= end) {
      wait_.note(false);
      return;
    }
  }
}

template <typename Message, typename Sample>
SampleCounts SampleInput<Message, Sample>::counts() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  SampleCounts counts = counts_;
  counts.alive = isAliveLocked();
  return counts;
}

template <typename Message, typename Sample>
bool SampleInput<Message, Sample>::isAliveLocked() const {
  return last_s_ && ros::WallTime::now().toSec() - *last_s_ < kTimeout_s;
}

template class SampleInput<sensor_msgs::Imu, ImuSample>;
template class SampleInput<nav_msgs::Odometry, OdometrySample>;

}  // namespace point_line_odometry
