#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>

#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_odometry.h"
#include "tools/recorded_run.h"

namespace point_line_odometry {

/// Differences between a replay and the recording.
struct RecordingComparison {
  std::size_t frames = 0;  ///< that are in both
  std::size_t equal = 0;   ///< with the same state, reason and pose, bit for bit
  double max_distance_m = 0.0;
  double max_angle_rad = 0.0;

  void add(const RecordedRun::Frame& recorded, const FrameResult& replayed);
};

/// Restores the state of an odometry at the start of a recording, sets the parameters as they
/// changed during it, and compares the results.
class RecordingReplay {
 public:
  explicit RecordingReplay(RecordedRun run);

  /// Throws InputError if the state cannot be used.
  /// \param instead parameters to be used throughout instead of the recorded ones.
  void begin(const std::optional<Parameters>& instead, StereoOdometry* odometry);

  /// To be called before a frame is processed.
  void prepare(std::int64_t stamp_ns, StereoOdometry* odometry) const;

  /// The recorded motion prior of a frame.
  std::optional<MotionPrior> priorOf(std::int64_t stamp_ns) const;

  /// To be called after that.
  void compare(const FrameResult& result);

  const RecordedRun& run() const { return run_; }
  const RecordingComparison& comparison() const { return comparison_; }

 private:
  const RecordedRun::Frame* find(std::int64_t stamp_ns) const;

  RecordedRun run_;
  std::map<std::int64_t, std::size_t> by_stamp_;
  RecordingComparison comparison_;
  bool own_parameters_ = false;
};

}  // namespace point_line_odometry
