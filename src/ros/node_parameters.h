#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <string>
#include <vector>

#include "dataset/mask_file.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// The name that means no frame.
constexpr const char* kNoFrame = "none";

/// Settings of the ROS node; those of the core are in Parameters.
struct NodeParameters {
  std::string odom_frame_id = "odom";
  std::string base_frame_id = "base_link";
  std::string guess_frame_id = kNoFrame;
  bool publish_tf = true;
  bool invert_tf = false;
  struct {
    double x = 0.0;
    double y = 0.0;
    double z = 0.0;
    double roll = 0.0;
    double pitch = 0.0;
    double yaw = 0.0;
  } initial_pose;

  bool approximate_sync = false;
  double approximate_sync_max_interval_s = 0.01;
  int queue_size = 5;
  std::string image_transport = "raw";
  bool rectify = false;
  struct {
    std::string mask = kNoMask;
  } left, right;
  std::string mask_images = "none";
  double mask_wait_s = 0.2;
  std::string on_time_jump = "reset";
  double watchdog_timeout_s = 5.0;
  double target_frame_time_ms = 0.0;

  struct {
    int frames = 60;
    int max_memory_mb = 100;
    bool when_lost = true;
    double lost_period_s = 60.0;
    int max_files = 5;
    std::string folder = "recordings";
  } recorder;

  int path_max_length = 5000;
  int landmarks_max_count = 5000;
};

/// The one table of the node's parameters; `visit` is called as by visitParameters(), and for free
/// text as `visit(name, value, text)`.
template <typename AnyNodeParameters, typename Visitor>
// NOLINTNEXTLINE(readability-function-size): a table
void visitNodeParameters(AnyNodeParameters& p, Visitor&& visit) {
  visit("odom_frame_id", p.odom_frame_id, "frame in which the pose is published");
  visit("base_frame_id", p.base_frame_id,
        "frame whose pose is published; tf must know the pose of the camera in it");
  visit("guess_frame_id", p.guess_frame_id,
        "frame in which tf knows the pose of base_frame_id by another odometry: its motion between "
        "the stamps of two frames is used instead of the topic prior_odom, whatever "
        "wheels/enabled is; tf is then odom_frame_id -> guess_frame_id. none: not used");
  visit("publish_tf", p.publish_tf, "publish odom_frame_id -> base_frame_id on tf");
  visit("invert_tf", p.invert_tf,
        "publish the inverse tf, for trees where base_frame_id already has a parent");
  visit("initial_pose/x", p.initial_pose.x, -1e6, 1e6, "m",
        "pose of base_frame_id in odom_frame_id at the first frame");
  visit("initial_pose/y", p.initial_pose.y, -1e6, 1e6, "m", "as initial_pose/x");
  visit("initial_pose/z", p.initial_pose.z, -1e6, 1e6, "m", "as initial_pose/x");
  visit("initial_pose/roll", p.initial_pose.roll, -6.3, 6.3, "rad", "about x, applied first");
  visit("initial_pose/pitch", p.initial_pose.pitch, -6.3, 6.3, "rad", "about y, applied second");
  visit("initial_pose/yaw", p.initial_pose.yaw, -6.3, 6.3, "rad", "about z, applied last");

  visit(
      "approximate_sync", p.approximate_sync,
      "pair left and right images whose stamps differ; only for cameras without a common trigger");
  visit("approximate_sync_max_interval_s", p.approximate_sync_max_interval_s, 0.0, 1.0, "s",
        "largest difference of stamps within such a pair; with more than half of it a pair waits "
        "for the next one");
  visit("queue_size", p.queue_size, 1, 1000, "frames",
        "pairs that may wait while the odometry is busy; the oldest is dropped first");
  visit("image_transport", p.image_transport,
        "transport of the input images: raw, compressed, ...");
  visit("rectify", p.rectify, "subscribe to image_raw and rectify here with camera_info");
  visit("left/mask", p.left.mask,
        "file of an image of the left camera's size (before rectification, if `rectify`), 8 bit: "
        "pixels where it is 0 are ignored; none: all are used");
  visit("right/mask", p.right.mask, "the same for the right camera");
  visit("mask_images", p.mask_images, std::vector<std::string>{"none", "left", "right", "both"},
        "cameras with a mask for each image on left/mask_image or right/mask_image, in addition to "
        "the files");
  visit("mask_wait_s", p.mask_wait_s, 0.0, 10.0, "s",
        "time that a pair waits for its masks after it has come; then it is used without them");
  visit("on_time_jump", p.on_time_jump, std::vector<std::string>{"reset", "keep_pose", "ignore"},
        "when stamps jump back by more than a second and three messages in a row confirm it: start "
        "at initial_pose, go on from the last pose, or drop frames");
  visit("watchdog_timeout_s", p.watchdog_timeout_s, 0.5, 3600.0, "s",
        "time without a pair of images after which a warning says what is missing");
  visit("target_frame_time_ms", p.target_frame_time_ms, 0.0, 10000.0, "ms",
        "while frames take longer from input to output on the mean, fewer features are used, down "
        "to a fifth, and every second frame is tracked by landmarks alone if that leaves no doubt; "
        "0: never, the result does not depend on the computer");

  visit("recorder/frames", p.recorder.frames, 0, 100000, "frames",
        "latest pairs kept to be written to a bag and replayed, the later half of them at least; "
        "0: none");
  visit("recorder/max_memory_mb", p.recorder.max_memory_mb, 1, 1000000, "MB",
        "of the images of these pairs; fewer are kept if they are large. The states at which a "
        "replay can begin add about 20 MB");
  visit("recorder/when_lost", p.recorder.when_lost, "write them when the state becomes LOST");
  visit("recorder/lost_period_s", p.recorder.lost_period_s, 0.0, 1e6, "s",
        "shortest time between two recordings when LOST, wall time");
  visit("recorder/max_files", p.recorder.max_files, 1, 100000, "recordings",
        "kept on disk: the newest of each kind, written when LOST and by the service");
  visit("recorder/folder", p.recorder.folder,
        "where a folder of this node is made for them; within ROS_HOME (~/.ros) unless it begins "
        "with a slash");

  visit("path_max_length", p.path_max_length, 2, 1000000, "poses",
        "latest poses kept in the topic path");
  visit("landmarks_max_count", p.landmarks_max_count, 0, 1000000, "segments",
        "latest accumulated segments in the topic lines");
}

/// Names in the table above, for loadParameters()' `ignored`.
std::vector<std::string> nodeParameterNames();

/// One sentence for each node parameter that is out of its range or not among its choices; empty if
/// all are fine.
std::vector<std::string> checkNodeParameters(const NodeParameters& parameters);

/// Pairs of the fastest cameras in a time.
std::size_t pairsWhile(double seconds);

/// Whether images of a camera (0: left) have masks of their own.
bool expectsMask(const NodeParameters& parameters, std::size_t camera);

/// Whether the motion of the base in another frame is looked up in tf.
bool usesTfGuess(const NodeParameters& parameters);

/// Pose of the base in odom at the first frame.
Eigen::Isometry3d initialPose(const NodeParameters& parameters);

/// Both tables.
struct AllParameters {
  NodeParameters node;
  Parameters core;
};

/// Whether wheels, or what replaces them in tf, give motion priors.
bool usesWheels(const AllParameters& parameters);

}  // namespace point_line_odometry
