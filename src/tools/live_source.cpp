#include "tools/live_source.h"

#include <ros/callback_queue.h>
#include <ros/init.h>
#include <ros/master.h>

#include <optional>

#include "common/input_error.h"
#include "ros/calibration_conversion.h"
#include "ros/image_conversion.h"
#include "ros/parameter_loader.h"
#include "ros/remapped_names.h"
#include "ros/stereo_subscriber.h"
#include "tools/interruption.h"

namespace point_line_odometry {
namespace {

constexpr double kLongestWait_s = 10.0;  // for a pair

/// Where the odometry's node has its private parameters.
ros::NodeHandle nodeOf(const LiveOptions& options) {
  return {ros::NodeHandle(options.name_space), options.node};
}

NodeParameters readParameters(const LiveOptions& options) {
  NodeParameters parameters = loadNodeParameters(nodeOf(options)).node;
  if (!options.rectify.empty()) parameters.rectify = options.rectify == "true";
  if (!options.transport.empty()) parameters.image_transport = options.transport;
  if (options.max_interval_s > 0.0) {
    parameters.approximate_sync = true;
    parameters.approximate_sync_max_interval_s = options.max_interval_s;
  }
  return parameters;
}

class LiveSource : public StereoSource {
 public:
  explicit LiveSource(const LiveOptions& options)
      : nh_(options.name_space, loadRemappings(nodeOf(options))),
        parameters_(readParameters(options)),
        subscriber_(nh_, ros::NodeHandle("~"), parameters_,
                    [this](const StereoMessages& set) { newest_ = set; }) {
    if (!waitForPair()) throw InputError(subscriber_.explainTimeout());
    left_info_ = newest_->left_info;
    right_info_ = newest_->right_info;
    try {
      calibration_ = toStereoCalibration(*left_info_, *right_info_);
    } catch (const MessageError& error) {
      throw InputError(error.what());
    }
    end_ = ros::WallTime::now() + ros::WallDuration(options.seconds);
  }

  std::size_t size() const override { return 0; }
  const StereoCalibration& calibration() const override { return calibration_; }
  bool needsRectification() const override { return parameters_.rectify; }

  std::optional<StereoImages> next() override {
    if (ros::WallTime::now() >= end_ || !waitForPair()) return std::nullopt;
    current_ = *newest_;  // keeps the images alive
    newest_.reset();
    if (!sameCalibration(*current_.left_info, *left_info_) ||
        !sameCalibration(*current_.right_info, *right_info_)) {
      throw InputError("camera_info has changed meanwhile: start again");
    }
    try {
      return toStereoImages(*current_.left, *current_.right, calibration_);
    } catch (const MessageError& error) {
      throw InputError(error.what());
    }
  }

 private:
  /// Takes what has arrived; false if no pair does for too long.
  bool waitForPair() {
    const ros::WallTime latest = ros::WallTime::now() + ros::WallDuration(kLongestWait_s);
    ros::getGlobalCallbackQueue()->callAvailable();
    while (!newest_ && ros::ok() && ros::WallTime::now() < latest) {
      throwIfInterrupted();
      ros::getGlobalCallbackQueue()->callOne(ros::WallDuration(0.05));
    }
    return newest_.has_value();
  }

  ros::NodeHandle nh_;
  NodeParameters parameters_;
  std::optional<StereoMessages> newest_;
  StereoSubscriber subscriber_;
  StereoMessages current_;
  sensor_msgs::CameraInfoConstPtr left_info_;
  sensor_msgs::CameraInfoConstPtr right_info_;
  StereoCalibration calibration_;
  ros::WallTime end_;
};

}  // namespace

void initLive(const char* node_name, int* argc, char** argv) {
  ros::init(*argc, argv, node_name,
            ros::init_options::AnonymousName | ros::init_options::NoSigintHandler);
}

std::unique_ptr<StereoSource> openLive(const LiveOptions& options) {
  if (!ros::master::check()) {  // a node handle would wait for it
    throw InputError("no ROS master answers at " + ros::master::getURI() +
                     ": start the robot's or set ROS_MASTER_URI, or name a bag");
  }
  return std::make_unique<LiveSource>(options);
}

}  // namespace point_line_odometry
