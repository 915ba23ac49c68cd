#pragma once

#include <sensor_msgs/Image.h>

#include <array>

#include "ros/conversions.h"

namespace point_line_odometry {

/// Cuts an image that shows two cameras side by side in two, with its header; pixels are copied as
/// they are. Bayer patterns and yuv422 keep their order only if a half has an even width. Throws
/// MessageError if the width is odd (or that of a half, where it must be even), or if sizes
/// contradict each other.
std::array<sensor_msgs::ImagePtr, 2> cutInTwo(const sensor_msgs::Image& image);

}  // namespace point_line_odometry
