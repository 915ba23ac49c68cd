#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <std_msgs/Header.h>

#include <string>

#include "point_line_odometry/rectification.h"
#include "ros/conversions.h"

namespace point_line_odometry {

/// Calibration of the images as they are transmitted: K and P with region of interest and binning
/// applied (fields that are 0 are unset). Throws MessageError if P cannot belong to a rectified
/// pair: absent, not finite, f <= 0, baseline <= 0, or if left and right differ in size.
StereoCalibration toStereoCalibration(const sensor_msgs::CameraInfo& left,
                                      const sensor_msgs::CameraInfo& right);

/// K, D, R, P and size of a camera; no binning, no region of interest.
sensor_msgs::CameraInfo toCameraInfo(const CameraCalibration& calibration,
                                     const std_msgs::Header& header);

/// Name of the first field in which the messages describe different cameras, null if they do not;
/// the header does not count.
const char* differingField(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b);

/// True if there is no such field.
bool sameCalibration(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b);

/// The camera_infos of a pair; equal if they describe the same cameras.
struct InfoPair {
  sensor_msgs::CameraInfoConstPtr left;
  sensor_msgs::CameraInfoConstPtr right;

  bool operator==(const InfoPair& other) const;
};

/// For example "right/camera_info: P", which is the first field that differs.
std::string differenceOf(const InfoPair& a, const InfoPair& b);

}  // namespace point_line_odometry
