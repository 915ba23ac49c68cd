// A nodelet that takes the features of the odometry: in the same manager it gets the message
// without a copy. For each frame it publishes the distance of the nearest thing that stands still,
// for example to slow down before it.
//   subscribes to features (point_line_odometry/StereoFeatures)
//   publishes ~nearest (sensor_msgs/Range), in the frame of the left camera; +inf: nothing is near
//   parameter ~max_range [m], default 20
#include <nodelet/nodelet.h>
#include <point_line_odometry/StereoFeatures.h>
#include <ros/ros.h>
#include <sensor_msgs/Range.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <pluginlib/class_list_macros.hpp>

namespace point_line_odometry_examples {

class NodeletConsumer : public nodelet::Nodelet {
 private:
  void onInit() override {
    max_range_m_ = getPrivateNodeHandle().param("max_range", 20.0);
    publisher_ = getPrivateNodeHandle().advertise<sensor_msgs::Range>("nearest", 10);
    subscriber_ = getNodeHandle().subscribe("features", 10, &NodeletConsumer::take, this);
  }

  void take(const point_line_odometry::StereoFeaturesConstPtr& features) {
    double nearest_m = std::numeric_limits<double>::infinity();
    const auto consider = [&](const geometry_msgs::Point32& p) {
      const double distance_m = std::hypot(p.x, p.y, p.z);
      if (distance_m <= max_range_m_) nearest_m = std::min(nearest_m, distance_m);
    };
    // Inliers alone: what does not fit the motion of the camera moves by itself, or is matched
    // wrongly.
    for (const auto& point : features->points) {
      if (point.inlier) consider(point.point);
    }
    for (const auto& line : features->lines) {
      if (!line.inlier) continue;
      consider(line.start);
      consider(line.end);
    }
    publish(features->header, nearest_m);
  }

  void publish(const std_msgs::Header& header, double range_m) const {
    auto message = boost::make_shared<sensor_msgs::Range>();  // by pointer: no copy here either
    message->header = header;
    message->max_range = static_cast<float>(max_range_m_);
    message->range = static_cast<float>(range_m);
    publisher_.publish(message);
  }

  double max_range_m_ = 20.0;
  ros::Publisher publisher_;
  ros::Subscriber subscriber_;
};

}  // namespace point_line_odometry_examples

PLUGINLIB_EXPORT_CLASS(point_line_odometry_examples::NodeletConsumer, nodelet::Nodelet)
