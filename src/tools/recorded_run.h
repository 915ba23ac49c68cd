#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/tilt_correction.h"
#include "tools/stereo_topics.h"

namespace point_line_odometry {

/// A recording of the flight recorder without its images: what is needed to reproduce the results,
/// and these results.
struct RecordedRun {
  struct Frame {
    std::int64_t stamp_ns = 0;
    std::string state;
    std::string reason;
    Eigen::Isometry3d T_odom_camera = Eigen::Isometry3d::Identity();
    std::optional<MotionPrior> prior;
    std::optional<TiltCorrection> tilt;
    std::optional<Parameters> parameters;  ///< changed from this frame on
  };

  std::string version;  ///< of the package that wrote it
  std::string bag;
  StereoTopics topics;
  std::int64_t max_interval_ns = 0;
  bool has_masks = false;  ///< its bag has those that were used
  std::string state;       ///< see StereoOdometry::saveState()
  Parameters parameters;
  std::vector<Frame> frames;
  std::vector<std::string> warnings;  ///< of parameters that an earlier version had
};

/// True for the yaml of a recording, by its name.
bool isRecordingName(const std::string& input);

/// Reads the yaml of a recording and its state file. Throws InputError if one of them is missing,
/// damaged or of another kind.
RecordedRun readRecording(const std::string& file);

}  // namespace point_line_odometry
