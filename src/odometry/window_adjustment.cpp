#include "odometry/window_adjustment.h"

#include <utility>

namespace point_line_odometry {
namespace {

// Iterations of an adjustment: 10 of them change the errors of one of five sequences, its ATE from
// 0.1562 to 0.1564 m. The next keyframe's adjustment goes on where this one ends.
constexpr int kMaxIterations = 5;

}  // namespace

void WindowAdjustment::start(const StereoCamera& camera, const Parameters& parameters,
                             std::optional<LocalMap>* map) {
  if (!*map) return;
  std::optional<BundleProblem> problem = (*map)->takeProblem(parameters.window);
  if (!problem) return;
  const auto launch = parameters.tracking.threads > 1 ? std::launch::async : std::launch::deferred;
  result_ = std::async(
      launch, [camera, motion = parameters.motion, bundle = std::move(*problem)]() mutable {
        const bool solved = adjustBundle(camera, motion, kMaxIterations, &bundle);
        return solved ? std::make_optional(std::move(bundle)) : std::nullopt;
      });
}

int WindowAdjustment::finish(std::optional<LocalMap>* map) {
  if (!result_.valid()) return 0;
  const std::optional<BundleProblem> solved = result_.get();
  if (solved && *map) (*map)->applyResult(*solved);
  return solved ? 0 : 1;
}

}  // namespace point_line_odometry
