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
#include <string>
#include <vector>

#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/stereo_odometry.h"

namespace point_line_odometry {

/// What the odometry made of a pair of messages, with all that is needed to say it in ROS' terms.
struct ProcessedFrame {
  std_msgs::Header header;  ///< of the left image: stamp, and the camera frame that tf knows
  FrameResult result;
  cv::Mat left;  ///< rectified left image, CV_8UC1; may share the memory of `left_message`
  sensor_msgs::ImageConstPtr left_message;
  StereoCamera camera;
  LineDetectorKind line_detector = LineDetectorKind::kNone;  ///< that ran
  double feature_budget = 1.0;  ///< share of the configured numbers of features that it could use
  /// Pose of the rectified left camera in the base.
  Eigen::Isometry3d T_base_camera = Eigen::Isometry3d::Identity();
  /// From the rectified left camera to the frame of `header`: the rectifying rotation undone.
  Eigen::Isometry3d T_header_camera = Eigen::Isometry3d::Identity();

  /// Pose of the base in odom.
  Eigen::Isometry3d T_odom_base() const { return result.T_odom_camera * T_base_camera.inverse(); }
};

/// Names of the two frames of the odometry.
struct FrameNames {
  std::string odom;
  std::string base;
};

/// Frames counted since start-up, and messages that made none.
struct FrameCounters {
  std::uint64_t processed = 0;
  std::uint64_t dropped = 0;
  std::uint64_t rejected = 0;
  std::uint64_t exceptions = 0;
  std::uint64_t stamps_rejected = 0;  ///< images and camera_infos, see StampFilter
  std::uint64_t relocalizations = 0;  ///< frames, see FrameCounts
};

/// A line segment fixed in odom [m].
struct LandmarkSegment {
  Eigen::Vector3d start = Eigen::Vector3d::Zero();
  Eigen::Vector3d end = Eigen::Vector3d::Zero();
};

/// Pose of the base in odom, twist in the base, both with covariances.
nav_msgs::Odometry toOdometry(const ProcessedFrame& frame, const FrameNames& names);

/// odom -> base, or base -> odom if `invert`.
geometry_msgs::TransformStamped toTransformStamped(const ProcessedFrame& frame,
                                                   const FrameNames& names, bool invert);

/// Inlier points: x y z [m] in the frame of the header, intensity of the left image.
sensor_msgs::PointCloud2 toPointCloud(const ProcessedFrame& frame);

/// Matched segments in the frame of the header: inliers green, outliers red. A kind
/// that is absent is deleted, as rviz takes no empty marker.
visualization_msgs::MarkerArray toLineMarkers(const ProcessedFrame& frame);

/// Landmarks in odom, blue.
visualization_msgs::Marker toLandmarkMarker(const std::deque<LandmarkSegment>& landmarks,
                                            const std_msgs::Header& header);

/// Removes every marker that was published before.
visualization_msgs::Marker deleteAllMarkers(const std_msgs::Header& header);

/// Inlier segments that are near enough to be well placed, in odom.
std::vector<LandmarkSegment> toLandmarks(const ProcessedFrame& frame);

/// Matched points and segments; 3-D in the frame of the header.
StereoFeatures toFeatures(const ProcessedFrame& frame);

/// State, counts and times. `latency_ms` is 0 where the clock cannot tell.
OdometryInfo toInfo(const ProcessedFrame& frame, const FrameCounters& counters, double latency_ms);

/// drawFeatures() as a bgr8 image.
sensor_msgs::ImagePtr toFeaturesImage(const ProcessedFrame& frame);

/// Time from `stamp` to `now` [ms]; 0 if it is negative or too long for a clock that runs with the
/// stamps.
double latencyMs(const ros::Time& stamp, const ros::Time& now);

}  // namespace point_line_odometry
