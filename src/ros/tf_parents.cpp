#include "ros/tf_parents.h"

#include <ros/time.h>

#include <algorithm>
#include <boost/function.hpp>
#include <limits>
#include <utility>

#include "ros/conversions.h"

namespace point_line_odometry {

std::optional<TfEdge> transformOfOdometry(const NodeParameters& parameters) {
  if (!parameters.publish_tf) return std::nullopt;
  const std::string& moved =
      parameters.guess_frame_id == kNoFrame ? parameters.base_frame_id : parameters.guess_frame_id;
  if (parameters.invert_tf) return TfEdge{moved, parameters.odom_frame_id};
  return TfEdge{parameters.odom_frame_id, moved};
}

std::string topmostFrame(const tf2::BufferCore& tf, const std::string& frame,
                         const std::string& odom) {
  constexpr int kDeepest = 100;  // trees that change may be seen as loops
  const std::array<std::string, 5> not_of_robot{odom, "odom", "map", "earth", "world"};
  std::string topmost = frame;
  std::string parent;
  for (int depth = 0; depth < kDeepest; ++depth) {
    if (!tf._getParent(topmost, ros::Time(0), parent) || parent.empty()) break;
    if (std::find(not_of_robot.begin(), not_of_robot.end(), parent) != not_of_robot.end()) break;
    topmost = parent;
  }
  return topmost;
}

TfParents::TfParents(ros::NodeHandle nh, std::optional<TfEdge> own) : own_(std::move(own)) {
  if (!own_) return;
  const auto subscribe = [&](const std::string& topic, bool latched) {
    constexpr std::uint32_t kQueueSize = 100;
    const boost::function<void(const ros::MessageEvent<const tf2_msgs::TFMessage>&)> callback =
        [this, latched](const ros::MessageEvent<const tf2_msgs::TFMessage>& event) {
          take(event, latched);
        };
    return nh.subscribe<tf2_msgs::TFMessage>(topic, kQueueSize, callback);
  };
  subscribers_ = {subscribe("/tf", false), subscribe("/tf_static", true)};
}

std::vector<TfParents::Source> TfParents::othersThan(const std::string& node) const {
  const double now_s = ros::WallTime::now().toSec();
  const std::lock_guard<std::mutex> lock(mutex_);
  std::vector<Source> others;
  for (const auto& [source, until_s] : valid_until_s_) {
    const bool is_own = source.publisher == node && source.parent == own_->parent;
    if (until_s >= now_s && !is_own) others.push_back(source);
  }
  return others;
}

void TfParents::take(const ros::MessageEvent<const tf2_msgs::TFMessage>& event, bool latched) {
  constexpr std::size_t kMost = 10;
  constexpr double kRemembered_s = 5.0;
  const double until_s = latched ? std::numeric_limits<double>::infinity()
                                 : ros::WallTime::now().toSec() + kRemembered_s;
  for (const geometry_msgs::TransformStamped& transform : event.getConstMessage()->transforms) {
    if (withoutLeadingSlash(transform.child_frame_id) != own_->child) continue;
    const Source source{event.getPublisherName(), withoutLeadingSlash(transform.header.frame_id)};
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto known = valid_until_s_.find(source);
    if (known != valid_until_s_.end()) {
      known->second = std::max(known->second, until_s);
    } else if (valid_until_s_.size() < kMost) {
      valid_until_s_.emplace(source, until_s);
    }
  }
}

}  // namespace point_line_odometry
