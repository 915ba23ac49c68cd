#include "odometry/prior_chain.h"

#include "motion/prior_factor.h"

namespace point_line_odometry {

FramePrior PriorChain::prepare(const MotionPrior* given, std::optional<std::int64_t> last_ns,
                               std::optional<std::int64_t> previous_ns,
                               std::int64_t stamp_ns) const {
  FramePrior prior;
  if (given == nullptr || !last_ns) return prior;
  if (given->from_ns != *last_ns || given->to_ns != stamp_ns || !isUsable(*given)) {
    prior.use = PriorUse::kInvalid;
    return prior;
  }
  prior.use = trust_.isTrusted() ? PriorUse::kUsed : PriorUse::kSuspended;
  prior.since_last = *given;
  if (previous_ns == last_ns) {
    prior.since_previous = *given;
  } else if (since_previous_ && since_previous_->from_ns == previous_ns &&
             since_previous_->to_ns == *last_ns) {
    prior.since_previous = composed(*since_previous_, *given);
  }
  return prior;
}

void PriorChain::update(const FramePrior& prior, bool compared, bool agreed) {
  since_previous_ = prior.since_previous;
  if (compared) trust_.update(agreed);
}

}  // namespace point_line_odometry
