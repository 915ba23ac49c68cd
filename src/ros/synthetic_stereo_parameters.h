#pragma once

#include <xmlrpcpp/XmlRpcValue.h>

#include <string>

#include "world/synthetic_world.h"

namespace point_line_odometry {

/// Settings of the synthetic stereo camera.
struct SyntheticStereoParameters {
  SyntheticWorldOptions world;

  std::string as;
  std::string path;
  int frames = 0;
  double length_m = 0.0;
  bool exit_when_done = false;
  bool wait_for_subscribers = true;
  double delay_s = 0.0;
  bool publish_clock = false;
  double rate = 1.0;
  std::string lockstep_topic;
  int path_max_length = 5000;

  std::string odom_frame_id = "odom";
  std::string base_frame_id = "base_link";
  std::string left_frame_id = "left_camera";
  std::string right_frame_id = "right_camera";
};

/// The table of the camera's own parameters, in addition to visitWorldOptions(); `visit` is called
/// as by visitNodeParameters().
template <typename AnyParameters, typename Visitor>
void visitSyntheticStereoParameters(AnyParameters& p, Visitor&& visit) {
  visit(
      "as", p.as,
      "camera to play, as its driver publishes it: realsense_d4xx, zed, oak_d, mynteye, stereo_usb "
      "or t265_fisheye; empty: the scene's own");
  visit("path", p.path,
        "file (TUM) of the left camera's trajectory to follow; empty: the scene's own motion");
  visit("frames", p.frames, 0, 1000000000, "", "number of frames after which to stop; 0: endless");
  visit("length", p.length_m, 0.0, 1e6, "m",
        "instead of `frames`: distance that the camera travels before it stops; 0: none");
  visit("exit_when_done", p.exit_when_done,
        "after the last frame end the process, with all nodelets in it");
  visit("wait_for_subscribers", p.wait_for_subscribers,
        "begin when both images and both camera_infos have subscribers");
  visit("delay_s", p.delay_s, 0.0, 3600.0, "s",
        "real time after that until the first frame, for further subscribers");
  visit("publish_clock", p.publish_clock,
        "publish simulated time on /clock: a slow computer slows the world down, no frame is lost");
  visit("rate", p.rate, 0.01, 100.0, "", "simulated seconds in a real one, at most");
  visit("lockstep_topic", p.lockstep_topic,
        "nav_msgs/Odometry that answers each frame before the next one comes; empty: none");
  visit("path_max_length", p.path_max_length, 2, 1000000, "poses",
        "latest poses kept in /ground_truth/path");
  visit("odom_frame_id", p.odom_frame_id, "frame of the ground truth");
  visit("base_frame_id", p.base_frame_id, "frame whose true pose is published");
  visit("left_frame_id", p.left_frame_id, "frame of the left images");
  visit("right_frame_id", p.right_frame_id, "frame of the right images");
}

/// Sets what `tree` (the struct of private parameters) names, and reads the file of `path`. Throws
/// std::runtime_error with one sentence that names every unknown name, wrong type, value out of
/// range and contradiction.
SyntheticStereoParameters parseSyntheticStereoParameters(const XmlRpc::XmlRpcValue& tree);

}  // namespace point_line_odometry
