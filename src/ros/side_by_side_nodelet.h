#pragma once

#include <image_transport/publisher.h>
#include <image_transport/subscriber.h>
#include <nodelet/nodelet.h>
#include <ros/publisher.h>
#include <sensor_msgs/CameraInfo.h>

#include <array>
#include <optional>
#include <string>

#include "ros/log_throttle.h"

namespace point_line_odometry {

/// Cuts the images of a camera that shows both sides in one (topic `image_raw`) in two and
/// publishes them like a pair of cameras, on `left/image_raw` and `right/image_raw`, with the stamp
/// of the image and, where files are given, `camera_info`.
///
/// Private parameters: left_calibration, right_calibration (files, empty: the camera_info comes
/// from elsewhere), left_frame_id, right_frame_id (empty: that of the image), swap (the left camera
/// is the right half), image_transport.
class SideBySideNodelet : public nodelet::Nodelet {
 private:
  struct Side {
    image_transport::Publisher images;
    ros::Publisher infos;
    std::optional<sensor_msgs::CameraInfo> info;
    std::string frame;
  };

  void onInit() override;
  void start();
  void take(const sensor_msgs::ImageConstPtr& image);
  void publish(const Side& side, const sensor_msgs::ImagePtr& half) const;

  std::array<Side, 2> sides_;
  image_transport::Subscriber subscriber_;
  bool swap_ = false;
  LogThrottle log_throttle_;
};

}  // namespace point_line_odometry
