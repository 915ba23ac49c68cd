#pragma once

#include <future>
#include <optional>

#include "map/bundle_adjustment.h"
#include "map/local_map.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Bundle adjustment of the map's window, in parallel to the first stages of the next frame. That
/// frame waits for the result, whenever it comes: the same input gives the same output.
class WindowAdjustment {
 public:
  /// Starts with the window of a new keyframe, if there is one.
  void start(const StereoCamera& camera, const Parameters& parameters,
             std::optional<LocalMap>* map);

  /// Waits for the result and applies it to the map it was started with. Returns how many windows
  /// (0 or 1) ended without a result.
  int finish(std::optional<LocalMap>* map);

  /// Waits, and drops the result: its map is no longer in use.
  void discard() { result_ = {}; }

 private:
  std::future<std::optional<BundleProblem>> result_;
};

}  // namespace point_line_odometry
