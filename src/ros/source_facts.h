#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "ros/sample_input.h"

namespace point_line_odometry {

/// What is known of a source of motion priors: the IMU, the wheels, or what else gives poses.
struct SourceFacts {
  /// After so many in a row without anything it is warned of a source: not of a gap.
  static constexpr int kManyFrames = 30;

  SampleCounts counts;
  std::string timeout;  ///< what to say if it is not alive
  std::string fault;    ///< of the frame of its last sample, empty if there is none
  std::map<std::string, std::uint64_t> unused;  ///< samples, by what was wrong with them
  int frames_without = 0;                       ///< successive frames for which they gave nothing
  std::optional<double> newest_s;  ///< stamp of the newest sample minus that of the last image
  bool trusted = true;             ///< see PriorTrust
};

/// Why frames have nothing of a source, with a hint; empty if they have. \param name of its
/// samples, as "imu samples".
std::string faultOf(const std::string& name, const SourceFacts& source);

}  // namespace point_line_odometry
