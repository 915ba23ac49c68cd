#include "ros/remapped_names.h"

#include <algorithm>
#include <string>

namespace point_line_odometry {
namespace {

constexpr const char* kNames[] = {
    "left/image_rect",   "left/image_raw",   "left/camera_info",
    "left/mask_image",   "right/image_rect", "right/image_raw",
    "right/camera_info", "right/mask_image", "imu",
    "prior_odom",
};

std::string parameterOf(std::string name) {
  std::replace(name.begin(), name.end(), '/', '_');
  return std::string(kRemappingsSection) + "/" + name;
}

}  // namespace

void publishRemappings(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh) {
  private_nh.deleteParam(kRemappingsSection);
  for (const char* name : kNames) {
    const std::string topic = nh.resolveName(name);
    const bool remapped = topic != nh.resolveName(name, false);
    if (remapped) private_nh.setParam(parameterOf(name), topic);
  }
}

std::string nameForTransport(const ros::NodeHandle& nh, const std::string& name,
                             const std::string& transport) {
  return transport == "raw" ? name : nh.resolveName(name);
}

ros::M_string loadRemappings(const ros::NodeHandle& private_nh) {
  ros::M_string remappings;
  for (const char* name : kNames) {
    std::string topic;
    if (private_nh.getParam(parameterOf(name), topic)) remappings[name] = topic;
  }
  return remappings;
}

}  // namespace point_line_odometry
