#pragma once

#include <sys/types.h>

#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Memory of a process [MB].
struct MemoryUse {
  double resident_MB = 0.0;
  double peak_MB = 0.0;  ///< largest resident memory so far
};

/// A process of its own that does nothing but take images and run the odometry on them, so that its
/// memory is that of the odometry and not of what reads or renders images.
class MemoryProbe {
 public:
  /// Forks: to be called while this process has only one thread. Throws std::system_error.
  explicit MemoryProbe(const Parameters& parameters);
  ~MemoryProbe();
  MemoryProbe(const MemoryProbe&) = delete;
  MemoryProbe& operator=(const MemoryProbe&) = delete;

  /// Runs the odometry on the next frame of a camera, which must be the same in all calls. Throws
  /// std::runtime_error if the process has ended.
  MemoryUse process(const StereoCamera& camera, const StereoImages& images);

 private:
  int socket_ = -1;
  pid_t child_ = -1;
};

}  // namespace point_line_odometry
