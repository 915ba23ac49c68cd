#include <nav_msgs/Odometry.h>
#include <nodelet/nodelet.h>
#include <point_line_odometry/StereoFeatures.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <ros/subscriber.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/String.h>

#include <cstdint>
#include <deque>
#include <functional>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

namespace point_line_odometry {

/// A nodelet in the odometry's manager that subscribes to its input and its output. Publishes a
/// line of text on ~seen for each message: "KIND STAMP_NS ADDRESS CONTENT", where KIND is left,
/// right or features, ADDRESS that of the message in memory, and CONTENT a hash of an image's
/// pixels or the number of features. Images are kept until the odometry of their stamp has come and
/// are then reported again, as left_after and right_after.
class PointerTapNodelet : public nodelet::Nodelet {
 private:
  struct Image {
    std::string kind;
    sensor_msgs::ImageConstPtr message;
  };

  void onInit() override {
    ros::NodeHandle& nh = getNodeHandle();
    seen_ = getPrivateNodeHandle().advertise<std_msgs::String>("seen", 1000);
    using OnImage = boost::function<void(const sensor_msgs::ImageConstPtr&)>;
    const OnImage left = [this](const auto& image) { takeImage({"left", image}); };
    const OnImage right = [this](const auto& image) { takeImage({"right", image}); };
    subscribers_ = {nh.subscribe("left/image_rect", 10, left),
                    nh.subscribe("right/image_rect", 10, right),
                    nh.subscribe("features", 10, &PointerTapNodelet::takeFeatures, this),
                    nh.subscribe("odom", 10, &PointerTapNodelet::takeOdometry, this)};
  }

  void takeImage(const Image& image) {
    tell(image, image.kind);
    images_.push_back(image);
    constexpr std::size_t kMostImages = 60;
    if (images_.size() > kMostImages) images_.pop_front();
  }

  void takeFeatures(const StereoFeaturesConstPtr& features) {
    tell("features", features->header.stamp, features.get(),
         features->points.size() + features->lines.size());
  }

  void takeOdometry(const nav_msgs::OdometryConstPtr& odometry) {
    for (const Image& image : images_) {
      if (image.message->header.stamp == odometry->header.stamp) tell(image, image.kind + "_after");
    }
  }

  void tell(const Image& image, const std::string& kind) {
    const auto& data = image.message->data;
    const std::string_view pixels(reinterpret_cast<const char*>(data.data()), data.size());
    tell(kind, image.message->header.stamp, image.message.get(),
         std::hash<std::string_view>()(pixels));
  }

  void tell(const std::string& kind, const ros::Time& stamp, const void* address,
            std::size_t content) {
    std::ostringstream text;
    text << kind << ' ' << stamp.toNSec() << ' ' << address << ' ' << content;
    std_msgs::String line;
    line.data = text.str();
    seen_.publish(line);
  }

  ros::Publisher seen_;
  std::vector<ros::Subscriber> subscribers_;
  std::deque<Image> images_;
};

}  // namespace point_line_odometry

PLUGINLIB_EXPORT_CLASS(point_line_odometry::PointerTapNodelet, nodelet::Nodelet)
