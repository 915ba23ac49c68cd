#include "point_line_odometry/stereo_camera.h"

#include <cmath>
#include <sstream>
#include <stdexcept>

namespace point_line_odometry {
namespace {

void requirePositive(const char* name, double value, const char* hint) {
  if (std::isfinite(value) && value > 0.0) return;
  std::ostringstream text;
  text << "stereo camera: " << name << " is " << value
       << ", but must be a number above 0: " << hint;
  throw std::invalid_argument(text.str());
}

/// As OpenCV's functions that interpolate, the detector counts columns and rows in 16 bits.
void requireSize(const char* name, int size) {
  constexpr int kLargest = 32767;
  requirePositive(name, size, "give the size of the images");
  if (size <= kLargest) return;
  std::ostringstream text;
  text << "stereo camera: " << name << " is " << size << " px, but at most " << kLargest
       << " px are possible";
  throw std::invalid_argument(text.str());
}

/// The principal point may lie outside of the image, but not by more than its size.
void requireNearImage(const char* name, double value, int size) {
  if (std::isfinite(value) && value > -size && value < 2.0 * size) return;
  std::ostringstream text;
  text << "stereo camera: " << name << " is " << value << " px, which no image of " << size
       << " px has: calibrate the pair again";
  throw std::invalid_argument(text.str());
}

}  // namespace

void StereoCamera::validate() const {
  requireSize("width", width);
  requireSize("height", height);
  requirePositive("fx", fx, "calibrate the pair");
  requirePositive("fy", fy, "calibrate the pair");
  requireNearImage("cx", cx, width);
  requireNearImage("cy", cy, height);
  requirePositive("baseline_m", baseline_m,
                  "P of the right camera must hold -fx * baseline in its fourth column; if the "
                  "value is negative, left and right are swapped");
  if (!std::isfinite(raw_rows)) {
    throw std::invalid_argument(
        "stereo camera: raw_rows is not a number, but must be 1, or what rectifiedCamera() gives");
  }
}

}  // namespace point_line_odometry
