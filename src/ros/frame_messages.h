#pragma once

/// \file
/// From one processed stereo frame to the messages that the node publishes. Free functions that
/// need no node.

#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <point_line_odometry/OdometryInfo.h>
#include <point_line_odometry/StereoFeatures.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>
#include <visualization_msgs/MarkerArray.h>

#include <Eigen/Geometry>
#include <deque>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/tilt_correction.h"

namespace point_line_odometry {

/// The masks that were used for a pair of messages.
struct FrameMasks {
  cv::Mat left;  ///< of the image as received, CV_8UC1: 0: ignored; empty: none
  cv::Mat right;
  int missing = 0;    ///< masks of the topics that were not there or could not be used
  std::string fault;  ///< why the last of these could not be used; empty if none came
};

/// The result of the odometry for a pair of messages, with what is needed to convert it to ROS
/// messages.
struct ProcessedFrame {
  std_msgs::Header header;  ///< of the left image: stamp, and the camera frame that tf knows
  FrameResult result;
  std::optional<MotionPrior> prior;    ///< that was given to the odometry
  std::optional<TiltCorrection> tilt;  ///< the same, before the frame
  bool floor_trusted = true;           ///< false while the flat floor is suspended
  cv::Mat left;  ///< rectified left image, CV_8UC1; may share the memory of `left_message`
  sensor_msgs::ImageConstPtr left_message;
  cv::Mat left_mask;  ///< of `left`; empty: nothing is masked
  FrameMasks masks;
  StereoCamera camera;
  LineDetectorKind line_detector = LineDetectorKind::kNone;  ///< that was used
  /// StereoCorrection::rmsPx() of the odometry after the frame.
  Eigen::Vector2d correction_px = Eigen::Vector2d::Zero();
  double feature_budget = 1.0;  ///< share of the configured numbers of features that was used
  /// Pose of the rectified left camera in the base.
  Eigen::Isometry3d T_base_camera = Eigen::Isometry3d::Identity();
  /// Pose of the base in guess_frame_id by tf; nothing without that, or if tf did not have it.
  std::optional<Eigen::Isometry3d> T_guess_base;
  /// From the rectified left camera to the frame of `header`: inverse of the rectifying rotation.
  Eigen::Isometry3d T_header_camera = Eigen::Isometry3d::Identity();

  /// Pose of the base in odom.
  Eigen::Isometry3d T_odom_base() const { return result.T_odom_camera * T_base_camera.inverse(); }
};

/// Names of the two frames of the odometry.
struct FrameNames {
  std::string odom;
  std::string base;
};

/// Frames and rejected messages since start-up.
struct FrameCounters {
  std::uint64_t processed = 0;
  std::uint64_t dropped = 0;
  std::uint64_t rejected = 0;
  std::uint64_t exceptions = 0;
  std::uint64_t stamps_rejected = 0;  ///< images and camera_infos, see StampFilter
  std::uint64_t relocalizations = 0;  ///< frames, see FrameCounts
  std::uint64_t masks_missing = 0;    ///< masks of the topics, see FrameMasks
};

/// A line segment in odom [m], kept for display only: not a landmark of the map.
struct AccumulatedSegment {
  Eigen::Vector3d start = Eigen::Vector3d::Zero();
  Eigen::Vector3d end = Eigen::Vector3d::Zero();
};

/// Pose of the base in odom, twist in the base, both with covariances.
nav_msgs::Odometry toOdometry(const ProcessedFrame& frame, const FrameNames& names);

/// odom -> base, or base -> odom if `invert`. \param T_child_base pose of the base in another child
/// of odom, whose name `names.base` is then.
geometry_msgs::TransformStamped toTransformStamped(
    const ProcessedFrame& frame, const FrameNames& names, bool invert,
    const Eigen::Isometry3d& T_child_base = Eigen::Isometry3d::Identity());

/// Inlier points: x y z [m] in the frame of the header, intensity of the left image.
sensor_msgs::PointCloud2 toPointCloud(const ProcessedFrame& frame);

/// Matched segments in the frame of the header: inliers green, outliers red. An empty marker, which
/// rviz rejects, becomes a deletion.
visualization_msgs::MarkerArray toLineMarkers(const ProcessedFrame& frame);

/// Accumulated segments in odom, blue; marker namespace `landmarks`.
visualization_msgs::Marker toAccumulatedMarker(const std::deque<AccumulatedSegment>& segments,
                                               const std_msgs::Header& header);

/// Removes every marker that was published before.
visualization_msgs::Marker deleteAllMarkers(const std_msgs::Header& header);

/// Inlier segments in odom that are near enough to have an accurate position.
std::vector<AccumulatedSegment> toAccumulatedSegments(const ProcessedFrame& frame);

/// Matched points and segments; 3-D in the frame of the header.
StereoFeatures toFeatures(const ProcessedFrame& frame);

/// State, counts and times. `latency_ms` as of latencyMs().
OdometryInfo toInfo(const ProcessedFrame& frame, const FrameCounters& counters, double latency_ms);

/// drawFeatures() as a bgr8 image, dimmed where the image is masked.
sensor_msgs::ImagePtr toFeaturesImage(const ProcessedFrame& frame);

/// Time from `stamp` to `now` [ms]; 0 if it is negative or so long that stamps and clock cannot
/// have the same time base.
double latencyMs(const ros::Time& stamp, const ros::Time& now);

}  // namespace point_line_odometry
