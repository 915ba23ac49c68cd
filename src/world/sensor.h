#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

namespace point_line_odometry::world {

/// Model of lens and image sensor.
struct Sensor {
  double exposure_ev = 0.0;   ///< [stops]
  double lens_blur_px = 0.5;  ///< standard deviation
  double vignetting = 0.2;    ///< share of light lost in the corners
  double noise = 1.5;         ///< standard deviation at middle grey [grey levels]
};

/// The CV_8UC1 image of a sensor for light (CV_32FC1, 1: white). Different seeds give different
/// noise.
cv::Mat expose(const cv::Mat& light, const Sensor& sensor, std::uint32_t seed);

}  // namespace point_line_odometry::world
