#include "ros/tf_parents.h"

#include <boost/function.hpp>
#include <utility>

#include "ros/calibration_conversion.h"
#include "ros/conversions.h"

namespace point_line_odometry {

std::string childFrameOfOdometry(const NodeParameters& parameters) {
  if (!parameters.publish_tf) return "";
  if (parameters.invert_tf) return parameters.odom_frame_id;
  return parameters.guess_frame_id == kNoFrame ? parameters.base_frame_id
                                               : parameters.guess_frame_id;
}

std::string topmostFrame(const tf2::BufferCore& tf, const std::string& frame) {
  constexpr int kDeepest = 100;  // trees that change may be seen as loops
  std::string topmost = frame;
  std::string parent;
  for (int depth = 0; depth < kDeepest; ++depth) {
    if (!tf._getParent(topmost, ros::Time(0), parent) || parent.empty()) break;
    topmost = parent;
  }
  return topmost;
}

TfParents::TfParents(ros::NodeHandle nh, std::string child) : child_(std::move(child)) {
  if (child_.empty()) return;
  constexpr std::uint32_t kQueueSize = 100;
  const boost::function<void(const ros::MessageEvent<const tf2_msgs::TFMessage>&)> take =
      [this](const ros::MessageEvent<const tf2_msgs::TFMessage>& event) { this->take(event); };
  subscribers_ = {nh.subscribe<tf2_msgs::TFMessage>("/tf", kQueueSize, take),
                  nh.subscribe<tf2_msgs::TFMessage>("/tf_static", kQueueSize, take)};
}

std::vector<TfParents::Source> TfParents::sources() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return {sources_.begin(), sources_.end()};
}

void TfParents::take(const ros::MessageEvent<const tf2_msgs::TFMessage>& event) {
  constexpr std::size_t kMost = 10;
  for (const geometry_msgs::TransformStamped& transform : event.getConstMessage()->transforms) {
    if (withoutLeadingSlash(transform.child_frame_id) != child_) continue;
    const std::lock_guard<std::mutex> lock(mutex_);
    if (sources_.size() < kMost)
      sources_.insert({event.getPublisherName(), withoutLeadingSlash(transform.header.frame_id)});
  }
}

}  // namespace point_line_odometry
