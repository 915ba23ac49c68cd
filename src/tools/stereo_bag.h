#pragma once

#include <cstddef>
#include <string>

#include "tools/stereo_source.h"

namespace point_line_odometry {

/// Where and how a stereo bag is written.
struct StereoBagOptions {
  std::string file;
  std::string name_space = "stereo";
  std::string compression = "none";
  std::size_t max_frames = 0;  ///< 0: all
  bool quiet = false;
};

/// Writes the pairs of a source to a bag and prints their topics. Throws InputError for invalid
/// options and files that cannot be read or written.
void writeStereoBag(StereoSource& source, const StereoBagOptions& options);

}  // namespace point_line_odometry
