#include "ros/stereo_input.h"

#include <ros/console.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <sstream>
#include <utility>
#include <vector>

#include "common/statistics.h"

namespace point_line_odometry {
namespace {

/// Messages that may have been in transport when all topics stopped.
constexpr std::uint64_t kFewMessages = 3;

constexpr std::size_t kRemembered = 32;  // latest stamps and times of a topic

template <typename Value>
void remember(const Value& value, std::deque<Value>* values) {
  values->push_back(value);
  if (values->size() > kRemembered) values->pop_front();
}

double rateOf(const std::deque<double>& times_s) {
  const double span_s = times_s.empty() ? 0.0 : times_s.back() - times_s.front();
  return span_s > 0.0 ? static_cast<double>(times_s.size() - 1) / span_s : 0.0;
}

/// Difference of stamps [s]; that of ros::Times throws if it is too long for a ros::Duration.
double distance_s(const ros::Time& a, const ros::Time& b) {
  return std::abs(a.toSec() - b.toSec());
}

}  // namespace

std::string stereoTopicName(StereoTopic topic, bool rectify) {
  const char* const image = rectify ? "image_raw" : "image_rect";
  const bool left = topic == kLeftImage || topic == kLeftInfo;
  const bool is_image = topic == kLeftImage || topic == kRightImage;
  return std::string(left ? "left/" : "right/") + (is_image ? image : "camera_info");
}

std::uint32_t stereoQueueSize(const NodeParameters& parameters) {
  constexpr int kShortestQueue = 10;
  return static_cast<std::uint32_t>(std::max(kShortestQueue, parameters.queue_size));
}

StereoInput::StereoInput(const NodeParameters& parameters, const TopicNames& names,
                         Callback callback, RejectionCallback rejected, Clock clock)
    : parameters_(parameters),
      callback_(std::move(callback)),
      rejected_(std::move(rejected)),
      clock_(std::move(clock)) {
  for (std::size_t i = 0; i < kNumStereoTopics; ++i) arrivals_[i].name = names[i];
  makeSynchronizer();
}

void StereoInput::makeSynchronizer() {
  const std::uint32_t queue_size = stereoQueueSize(parameters_);
  exact_.reset();
  near_.reset();
  waiting_.fill(false);
  if (parameters_.approximate_sync) {
    near_ = std::make_unique<message_filters::Synchronizer<NearPolicy>>(NearPolicy(queue_size));
    // Images of a camera are further apart than those of a pair may be. If the policy did not know,
    // it would wait for the next pair, to see whether one of its images is nearer.
    const ros::Duration max_interval(parameters_.approximate_sync_max_interval_s);
    near_->setMaxIntervalDuration(max_interval);
    for (std::size_t i = 0; i < kNumStereoTopics; ++i)
      near_->setInterMessageLowerBound(static_cast<int>(i), max_interval);
    near_->registerCallback(&StereoInput::completed, this);
  } else {
    exact_ = std::make_unique<message_filters::Synchronizer<ExactPolicy>>(ExactPolicy(queue_size));
    exact_->registerCallback(&StereoInput::completed, this);
  }
}

void StereoInput::addImage(StereoTopic topic, const sensor_msgs::ImageConstPtr& message,
                           double arrival_s) {
  if (topic == kLeftImage) {
    add<kLeftImage>(message, arrival_s);
  } else {
    add<kRightImage>(message, arrival_s);
  }
}

void StereoInput::addInfo(StereoTopic topic, const sensor_msgs::CameraInfoConstPtr& message,
                          double arrival_s) {
  if (topic == kLeftInfo) {
    add<kLeftInfo>(message, arrival_s);
  } else {
    add<kRightInfo>(message, arrival_s);
  }
}

/// An exception that left a callback would end every nodelet of the manager.
template <int topic, typename Message>
void StereoInput::add(const boost::shared_ptr<const Message>& message, double arrival_s) {
  constexpr auto kTopic = static_cast<StereoTopic>(topic);
  const ros::Time& stamp = message->header.stamp;
  noteArrival(kTopic, stamp, arrival_s);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if constexpr (topic == kLeftImage) latest_.left = message;
    if constexpr (topic == kRightImage) latest_.right = message;
    if constexpr (topic == kLeftInfo) latest_.left_info = message;
    if constexpr (topic == kRightInfo) latest_.right_info = message;
  }
  try {
    follow(kTopic,
           filters_[topic].add(stamp, clock_(), [this, message] { synchronise<topic>(message); }));
  } catch (const std::exception& error) {
    if (log_throttle_.passes("dropped")) {
      ROS_ERROR("images and camera_infos that waited for their partners are dropped: %s",
                error.what());
    }
    makeSynchronizer();
  }
}

template <int topic, typename Message>
void StereoInput::synchronise(const boost::shared_ptr<const Message>& message) {
  newest_ = std::max(newest_, message->header.stamp);
  if (exact_) {
    exact_->template add<topic>(message);
  } else {
    near_->template add<topic>(message);
  }
}

/// With approximate_sync messages wait for later ones, which might be nearer partners: those of a
/// set that is not delivered show that there are none.
void StereoInput::flush() {
  for (const StereoTopic topic : {kLeftImage, kRightImage, kLeftInfo, kRightInfo})
    follow(topic, filters_[topic].flush());
  if (!near_ || newest_.isZero()) return;
  flushing_ = true;
  const ros::Duration later(1.0 + 3.0 * parameters_.approximate_sync_max_interval_s);
  const auto image = boost::make_shared<Image>();
  const auto info = boost::make_shared<Info>();
  image->header.stamp = info->header.stamp = newest_ + later;
  near_->add<kLeftImage>(image);
  near_->add<kRightImage>(image);
  near_->add<kLeftInfo>(info);
  near_->add<kRightInfo>(info);
  makeSynchronizer();
  flushing_ = false;
}

/// Drops queued messages of this topic when its clock jumps, so that no set mixes messages from
/// before and after the jump. Those of the other topics are kept until they jump, too.
void StereoInput::follow(StereoTopic topic, const StampFilter::Decision& decision) {
  for (const StampFilter::Rejection& rejection : decision.rejected) reject(topic, rejection);
  if (decision.jump_s) {
    if (log_throttle_.passes("jump")) {
      ROS_WARN("stamps on %s have jumped by %.3f s", arrivals_[topic].name.c_str(),
               *decision.jump_s);
    }
    if (waiting_[topic]) makeSynchronizer();
  }
  for (const StampFilter::Deliver& deliver : decision.passed) {
    waiting_[topic] = true;
    deliver();
  }
}

void StereoInput::reject(StereoTopic topic, const StampFilter::Rejection& rejection) {
  const std::string text = arrivals_[topic].name + ": " + rejection.text();
  if (log_throttle_.passes("message rejected")) {
    ROS_WARN("message rejected: %s", text.c_str());
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++rejected_since_set_;
    last_rejection_ = text;
  }
  if (rejected_) rejected_(text);
}

void StereoInput::noteArrival(StereoTopic topic, const ros::Time& stamp, double arrival_s) {
  const std::lock_guard<std::mutex> lock(mutex_);
  Arrivals& arrivals = arrivals_[topic];
  ++arrivals.count;
  ++arrivals.since_set;
  remember(stamp, &arrivals.stamps);
  remember(arrival_s, &arrivals.times_s);
}

void StereoInput::completed(const sensor_msgs::ImageConstPtr& left,
                            const sensor_msgs::ImageConstPtr& right,
                            const sensor_msgs::CameraInfoConstPtr& left_info,
                            const sensor_msgs::CameraInfoConstPtr& right_info) {
  if (flushing_ && left->header.stamp > newest_) return;
  const StereoMessages set{left, right, left_info, right_info};
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++num_sets_;
    for (Arrivals& topic : arrivals_) topic.since_set = 0;
    rejected_since_set_ = 0;
    remember(std::max(arrivals_[kLeftImage].times_s.back(), arrivals_[kRightImage].times_s.back()),
             &set_times_s_);
    latest_set_ = set;
  }
  callback_(set);
}

InputFacts StereoInput::facts(double now_s) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  InputFacts facts;
  for (std::size_t i = 0; i < kNumStereoTopics; ++i) {
    facts.topics[i].name = arrivals_[i].name;
    facts.topics[i].messages = arrivals_[i].count;
    facts.topics[i].rate_hz = rateOf(arrivals_[i].times_s);
    if (arrivals_[i].count == 0) continue;
    facts.topics[i].since_latest_s = now_s - arrivals_[i].times_s.back();
    facts.unstamped = facts.unstamped || arrivals_[i].stamps.back().isZero();
  }
  facts.sets = num_sets_;
  const std::uint64_t lefts = arrivals_[kLeftImage].count;
  facts.unsynchronized = lefts > num_sets_ ? lefts - num_sets_ : 0;
  facts.set_rate_hz = rateOf(set_times_s_);
  facts.image_skew_s = skew(kLeftImage, kRightImage);
  const auto left = skew(kLeftImage, kLeftInfo);
  const auto right = skew(kRightImage, kRightInfo);
  if (left && right) facts.info_skew_s = std::max(*left, *right);
  facts.latest = latest_;
  facts.latest_set = latest_set_;
  return facts;
}

/// True if messages came before, and do not any more while others do.
bool StereoInput::hasStopped(const Arrivals& topic) const {
  return topic.count > 0 && topic.since_set == 0 && mostSinceSet() >= kFewMessages;
}

/// Topics that have stopped while others go on, or on which no message has ever come.
std::string StereoInput::missingTopics() const {
  std::string missing;
  for (const Arrivals& topic : arrivals_) {
    if (topic.count > 0 && !hasStopped(topic)) continue;
    missing += (missing.empty() ? "" : " and ") + topic.name;
  }
  return missing;
}

/// Largest number of messages of a topic since the last complete set.
std::uint64_t StereoInput::mostSinceSet() const {
  std::uint64_t most = 0;
  for (const Arrivals& topic : arrivals_) most = std::max(most, topic.since_set);
  return most;
}

/// Median distance of a topic's latest stamps to the nearest ones of another topic [s]; if there
/// are no sets any more, of the stamps since the last set only.
std::optional<double> StereoInput::skew(StereoTopic topic, StereoTopic other) const {
  const std::deque<ros::Time>& stamps = arrivals_[topic].stamps;
  const std::deque<ros::Time>& others = arrivals_[other].stamps;
  if (stamps.empty() || others.empty()) return std::nullopt;
  const std::uint64_t since_set = arrivals_[topic].since_set;
  const std::size_t count =
      since_set >= kFewMessages ? std::min<std::size_t>(since_set, stamps.size()) : stamps.size();
  std::vector<double> distances_s;
  for (auto stamp = stamps.end() - static_cast<std::ptrdiff_t>(count); stamp != stamps.end();
       ++stamp) {
    double nearest_s = distance_s(*stamp, others.front());
    for (const ros::Time& candidate : others) {
      nearest_s = std::min(nearest_s, distance_s(*stamp, candidate));
    }
    distances_s.push_back(nearest_s);
  }
  return median(std::move(distances_s));
}

std::string StereoInput::explainTimeout() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::ostringstream text;
  text.precision(3);
  text << "messages so far:";
  for (const Arrivals& topic : arrivals_) text << " " << topic.name << " " << topic.count << ",";
  const std::string missing = missingTopics();
  const bool all_stopped = num_sets_ > 0 && missing.empty() && mostSinceSet() < kFewMessages;
  text << " synchronised sets " << num_sets_ << "; ";
  const double skew_s = skew(kLeftImage, kRightImage).value_or(0.0);
  if (!missing.empty()) {
    text << "nothing arrives on " << missing
         << (num_sets_ > 0 ? " any more: check the camera and its driver"
                           : ": check that it is published and that the names are remapped to it");
  } else if (all_stopped) {
    text << "the camera has stopped publishing, or the bag is paused or has ended";
  } else if (rejected_since_set_ >= kFewMessages) {
    text << rejected_since_set_ << " messages were rejected for their stamps, the last on "
         << last_rejection_
         << ": let the driver stamp them with the time of exposure, and see that "
         << "use_sim_time is not set without a /clock";
  } else if (parameters_.approximate_sync) {
    text << "stamps of left and right differ by " << skew_s
         << " s: raise approximate_sync_max_interval_s above the difference of a pair, and check "
            "that image and camera_info carry the same stamp";
  } else {
    text << "stamps of left and right differ by " << skew_s
         << " s: trigger both cameras together, or set approximate_sync to true if that is small; "
            "image and camera_info must carry the same stamp";
  }
  return text.str();
}

}  // namespace point_line_odometry
