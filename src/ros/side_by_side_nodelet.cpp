#include "ros/side_by_side_nodelet.h"

#include <image_transport/image_transport.h>

#include <boost/make_shared.hpp>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>

#include "dataset/camera_info_file.h"
#include "ros/calibration_conversion.h"
#include "ros/parameter_tree.h"
#include "ros/remapped_names.h"
#include "ros/side_by_side.h"

namespace point_line_odometry {
namespace {

constexpr int kPairQueueSize = 5;

/// Its private parameters, as the class says.
struct SideBySideParameters {
  std::array<std::string, 2> calibrations;  // left, right
  std::array<std::string, 2> frame_ids;
  bool swap = false;
  std::string image_transport = "raw";
};

/// Throws std::runtime_error with all names and types that are wrong.
SideBySideParameters readParameters(const ros::NodeHandle& private_nh) {
  ParameterTree tree(readPrivateParameters(private_nh));
  SideBySideParameters p;
  tree("left_calibration", p.calibrations[0]);
  tree("right_calibration", p.calibrations[1]);
  tree("left_frame_id", p.frame_ids[0]);
  tree("right_frame_id", p.frame_ids[1]);
  tree("swap", p.swap);
  tree("image_transport", p.image_transport);
  tree.ignoreSection(p.image_transport);  // the transport's own
  requireNoParameterErrors(tree.errors());
  return p;
}

}  // namespace

void SideBySideNodelet::onInit() {
  try {
    start();
  } catch (const std::exception& error) {
    NODELET_FATAL("%s does not start: %s", getName().c_str(), error.what());
    sides_ = {};  // before the manager frees the queues
    subscriber_.shutdown();
    throw;
  }
}

void SideBySideNodelet::start() {
  ros::NodeHandle& nh = getNodeHandle();
  ros::NodeHandle& own = getPrivateNodeHandle();
  image_transport::ImageTransport transport(nh);
  const SideBySideParameters parameters = readParameters(own);
  swap_ = parameters.swap;
  const std::array<std::string, 2> names{"left", "right"};
  for (std::size_t i = 0; i < names.size(); ++i) {
    Side& side = sides_[i];
    const std::string& file = parameters.calibrations[i];
    side.frame = parameters.frame_ids[i];
    side.images = transport.advertise(names[i] + "/image_raw", kPairQueueSize);
    if (file.empty()) continue;
    side.info = toCameraInfo(readCameraInfo(file), {});
    side.infos = nh.advertise<sensor_msgs::CameraInfo>(names[i] + "/camera_info", kPairQueueSize);
  }
  const image_transport::TransportHints hints(parameters.image_transport, ros::TransportHints(),
                                              own);
  subscriber_ = transport.subscribe(nameForTransport(nh, "image_raw", hints.getTransport()),
                                    kPairQueueSize, &SideBySideNodelet::take, this, hints);
}

/// An exception that left this callback would end every nodelet of the manager.
void SideBySideNodelet::take(const sensor_msgs::ImageConstPtr& image) {
  try {
    const std::array<sensor_msgs::ImagePtr, 2> halves = cutInTwo(*image);
    publish(sides_[0], halves[swap_ ? 1 : 0]);
    publish(sides_[1], halves[swap_ ? 0 : 1]);
  } catch (const std::exception& error) {
    if (log_throttle_.passes("message rejected")) {
      NODELET_ERROR("message rejected: %s", error.what());
    }
  }
}

void SideBySideNodelet::publish(const Side& side, const sensor_msgs::ImagePtr& half) const {
  if (!side.frame.empty()) half->header.frame_id = side.frame;
  if (side.info) {
    if (side.info->width != half->width || side.info->height != half->height) {
      throw MessageError("a half of the image is " + std::to_string(half->width) + " x " +
                         std::to_string(half->height) + ", the calibration is of " +
                         std::to_string(side.info->width) + " x " +
                         std::to_string(side.info->height) +
                         ": set the driver to the size that was calibrated");
    }
    const auto info = boost::make_shared<sensor_msgs::CameraInfo>(*side.info);
    info->header = half->header;
    side.infos.publish(info);
  }
  side.images.publish(half);
}

}  // namespace point_line_odometry

PLUGINLIB_EXPORT_CLASS(point_line_odometry::SideBySideNodelet, nodelet::Nodelet)
