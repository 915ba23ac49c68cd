/// \file
/// The image transport "compressed", on the wire as ROS' own, for distributions that lack it; grey
/// images only.

#include <cv_bridge/cv_bridge.h>
#include <image_transport/simple_publisher_plugin.h>
#include <image_transport/simple_subscriber_plugin.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/image_encodings.h>

#include <opencv2/imgcodecs.hpp>
#include <pluginlib/class_list_macros.hpp>
#include <string>

namespace point_line_odometry {

class CompressedPublisher
    : public image_transport::SimplePublisherPlugin<sensor_msgs::CompressedImage> {
 public:
  std::string getTransportName() const override { return "compressed"; }

 protected:
  void publish(const sensor_msgs::Image& image,
               const PublishFn& publish_compressed) const override {
    if (image.encoding != sensor_msgs::image_encodings::MONO8) return;
    const cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), CV_8UC1,
                         const_cast<std::uint8_t*>(image.data.data()), image.step);
    sensor_msgs::CompressedImage compressed;
    compressed.header = image.header;
    compressed.format = "mono8; jpeg compressed ";
    if (cv::imencode(".jpg", pixels, compressed.data)) publish_compressed(compressed);
  }
};

class CompressedSubscriber
    : public image_transport::SimpleSubscriberPlugin<sensor_msgs::CompressedImage> {
 public:
  std::string getTransportName() const override { return "compressed"; }

 protected:
  void internalCallback(const sensor_msgs::CompressedImageConstPtr& compressed,
                        const Callback& callback) override {
    const cv::Mat pixels = cv::imdecode(compressed->data, cv::IMREAD_GRAYSCALE);
    if (pixels.empty()) return;
    callback(cv_bridge::CvImage(compressed->header, sensor_msgs::image_encodings::MONO8, pixels)
                 .toImageMsg());
  }
};

}  // namespace point_line_odometry

PLUGINLIB_EXPORT_CLASS(point_line_odometry::CompressedPublisher, image_transport::PublisherPlugin)
PLUGINLIB_EXPORT_CLASS(point_line_odometry::CompressedSubscriber, image_transport::SubscriberPlugin)
