#pragma once

#include <cstdint>
#include <optional>
#include <tuple>

#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/prior_trust.h"

namespace point_line_odometry {

/// The prior of a frame, as it may be used.
struct FramePrior {
  PriorUse use = PriorUse::kNone;             ///< kUsed unless there is a reason against it
  std::optional<MotionPrior> since_last;      ///< since the last frame, to carry the pose
  std::optional<MotionPrior> since_previous;  ///< since the frame that is matched with

  /// For the prediction and the estimate; null if it must not be used.
  const MotionPrior* ofMotion() const {
    return use == PriorUse::kUsed && since_previous ? &*since_previous : nullptr;
  }
  /// To carry the pose from the last frame; null likewise.
  const MotionPrior* ofStep() const { return use == PriorUse::kUsed ? &*since_last : nullptr; }
};

/// Composes the priors of frames since the one that is matched with, and suspends a source of
/// priors of which too many disagree with the images.
class PriorChain {
 public:
  /// \param given null: none. \param last_ns stamp of the last frame. \param previous_ns of the
  /// frame that is matched with; nothing before the second frame.
  FramePrior prepare(const MotionPrior* given, std::optional<std::int64_t> last_ns,
                     std::optional<std::int64_t> previous_ns, std::int64_t stamp_ns) const;

  /// \param compared whether the prior was compared with the images; \param agreed the result.
  void update(const FramePrior& prior, bool compared, bool agreed);

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [since_previous, trust] = *this;
    return std::tie(since_previous, trust);
  }

 private:
  std::optional<MotionPrior> since_previous_;  // up to the last frame
  PriorTrust trust_{4};  // of several sources the wrong one is suspended before
};

}  // namespace point_line_odometry
