#include "features/edge_chains.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace point_line_odometry {
namespace {

constexpr int kMemory = 32;       // pixels over which the mean direction is taken
constexpr int kMaxGap = 7;        // pixels that a chain may jump, e.g. at a crossing
constexpr int kPixelsPerGap = 5;  // that a chain must have for each of them
constexpr int kSlopeShift = 12;   // of slopes in fixed point
constexpr int kSlopeOne = 1 << kSlopeShift;
static_assert(kMaxGap + 1 <= EdgeMap::kMargin, "a jump and the step after it stay on the map");

/// Steps to the next pixel along an edge and across it, in the map.
struct Steps {
  std::int32_t along;
  std::int32_t across;
};

/// Along the main axis of the edge, with the brighter side on the right hand.
Steps stepsOf(const MeanDirection& gradient, std::int32_t stride) {
  const int quadrant = ((gradient.value() + 32) >> 6) & 3;  // 0: the gradient points to the right
  const bool steep = quadrant % 2 == 0;
  const std::int32_t along = steep ? -stride : 1;
  return {quadrant < 2 ? along : -along, steep ? 1 : stride};
}

/// The strongest pixel of the edge among one and its two neighbours across, or -1. Without
/// branches: which one it is cannot be foretold.
std::int32_t strongestAcross(std::int32_t i, std::int32_t across, const MeanDirection& mean,
                             const EdgeMap& map) {
  const auto candidate = [&](std::int32_t k) {
    return map[k].onlyIf(mean.agrees(map[k].direction()));
  };
  const EdgePixel middle = candidate(i);
  const EdgePixel before = candidate(i - across);
  const EdgePixel after = candidate(i + across);
  const EdgePixel side = after.strongerThan(before) ? after : before;
  const std::int32_t to_side = after.strongerThan(before) ? across : -across;
  const EdgePixel best = side.strongerThan(middle) ? side : middle;
  const std::int32_t step = side.strongerThan(middle) ? to_side : 0;
  return best ? i + step : -1;
}

constexpr int kOne = 1 << 14;

/// kOne / n.
struct Reciprocals {
  std::array<int, kMemory + 1> of{};

  constexpr Reciprocals() {
    for (int n = 1; n <= kMemory; ++n) of[n] = kOne / n;
  }
};
constexpr Reciprocals kReciprocals;

}  // namespace

void MeanDirection::add(std::uint8_t direction) {
  if (count_ < kMemory) ++count_;
  const int difference =
      static_cast<std::int16_t>(static_cast<std::uint16_t>((direction << 8) - mean_));
  mean_ = static_cast<std::uint16_t>(mean_ + difference * kReciprocals.of[count_] / kOne);
}

EdgeChains::EdgeChains() {
  for (int direction = 0; direction < 256; ++direction) {
    const double x = std::sin(direction * M_PI / 128.0);
    const double y = -std::cos(direction * M_PI / 128.0);
    const double longer = std::max(std::abs(x), std::abs(y));
    slopes_[direction] = {static_cast<int>(std::lround(kSlopeOne * x / longer)),
                          static_cast<int>(std::lround(kSlopeOne * y / longer))};
  }
}

/// The pixel straight ahead where the edge goes on for at least two pixels, or -1.
std::int32_t EdgeChains::beyondGap(std::int32_t from, int sign, const MeanDirection& mean,
                                   const EdgeMap& map) const {
  const Slope& slope = slopes_[mean.value()];
  const Steps steps = stepsOf(mean, map.stride());
  const int max_gap = std::min(static_cast<int>(chain_.size()) / kPixelsPerGap, kMaxGap);
  for (int gap = 2; gap <= max_gap; ++gap) {
    const int dx = (slope.x * gap + kSlopeOne / 2) >> kSlopeShift;
    const int dy = (slope.y * gap + kSlopeOne / 2) >> kSlopeShift;
    const std::int32_t landing =
        strongestAcross(from + sign * (dx + dy * map.stride()), steps.across, mean, map);
    if (landing >= 0 && strongestAcross(landing + sign * steps.along, steps.across, mean, map) >= 0)
      return landing;
  }
  return -1;
}

void EdgeChains::walk(std::int32_t from, int sign, MeanDirection* mean, EdgeMap* map) {
  for (std::int32_t here = from; here >= 0;) {
    const Steps steps = stepsOf(*mean, map->stride());
    for (const std::int32_t beside : {here - steps.across, here + steps.across})
      map->eraseIf(mean->agrees((*map)[beside].direction()), beside);
    std::int32_t next = strongestAcross(here + sign * steps.along, steps.across, *mean, *map);
    if (next < 0) next = beyondGap(here, sign, *mean, *map);
    if (next >= 0) {
      mean->add((*map)[next].direction());
      map->erase(next);
      chain_.push_back(next);
    }
    here = next;
  }
}

const std::vector<std::int32_t>& EdgeChains::follow(std::int32_t anchor, EdgeMap* map) {
  const std::uint8_t direction = (*map)[anchor].direction();
  map->erase(anchor);
  chain_.assign(1, anchor);
  MeanDirection backward(direction);
  walk(anchor, -1, &backward, map);
  std::reverse(chain_.begin(), chain_.end());
  MeanDirection forward(direction);
  walk(anchor, 1, &forward, map);
  return chain_;
}

}  // namespace point_line_odometry
