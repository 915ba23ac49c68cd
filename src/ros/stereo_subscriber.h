#pragma once

#include <image_transport/subscriber.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <ros/time.h>

#include <array>
#include <atomic>
#include <string>

#include "ros/node_parameters.h"
#include "ros/stereo_input.h"

namespace point_line_odometry {

/// Subscribes to the four topics of a stereo camera and calls back with synchronised sets.
class StereoSubscriber {
 public:
  /// \param nh names are resolved here: left/image_rect, right/image_rect (image_raw with
  /// `rectify`), left/camera_info,
  ///        right/camera_info.
  /// \param private_nh where the image transports look up their own parameters.
  /// \param callback called from the callback queue of `nh`, never from two threads at once if that
  /// is a serial queue.
  /// \param rejected likewise, see StereoInput.
  StereoSubscriber(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                   const NodeParameters& parameters, StereoInput::Callback callback,
                   StereoInput::RejectionCallback rejected = nullptr);

  StereoSubscriber(const StereoSubscriber&) = delete;
  StereoSubscriber& operator=(const StereoSubscriber&) = delete;

  /// Messages received so far.
  InputFacts facts() const;

  /// Time since the last complete set [s] of wall time, or since the start.
  double secondsSinceSet() const;

  /// As StereoInput's.
  std::string explainTimeout() const { return input_.explainTimeout(); }

 private:
  void subscribe(ros::NodeHandle nh, const ros::NodeHandle& private_nh);

  const NodeParameters parameters_;
  std::atomic<double> last_set_s_;  // wall time
  StereoInput input_;
  std::array<image_transport::Subscriber, 2> image_subscribers_;
  std::array<ros::Subscriber, 2> info_subscribers_;
};

}  // namespace point_line_odometry
