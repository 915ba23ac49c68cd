#include "features/edge_chains.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace point_line_odometry {
namespace {

constexpr int kMemory = 32;       // pixels over which the mean direction is taken
constexpr int kMaxGap = 7;        // pixels that a chain may jump, e.g. at a crossing
constexpr int kPixelsPerGap = 5;  // of a chain, for each pixel of a gap
constexpr int kSlopeShift = 12;   // of slopes in fixed point
constexpr int kSlopeOne = 1 << kSlopeShift;
static_assert(kMaxGap + 1 <= EdgeMap::kMargin, "a jump and the step after it stay on the map");

/// Index steps to the next pixel along an edge and along its normal.
struct Steps {
  std::int32_t along;
  std::int32_t normal;
};

/// Along the main axis of the edge, with the brighter side on the right.
Steps stepsOf(int quadrant, std::int32_t stride) {
  const bool steep = quadrant % 2 == 0;
  const std::int32_t along = steep ? -stride : 1;
  return {quadrant < 2 ? along : -along, steep ? 1 : stride};
}

/// An edge pixel and its index in the map.
struct PixelAt {
  std::int32_t index;
  EdgePixel pixel;
};

/// The strongest pixel of the edge among one and its two neighbours along the normal; none if all
/// are none. Without branches, which would be mispredicted.
inline PixelAt strongestAlongNormal(std::int32_t i, std::int32_t normal, MeanDirection mean,
                                    const EdgeMap& map) {
  const auto candidate = [&](std::int32_t k) {
    return map[k].onlyIf(mean.agrees(map[k].direction()));
  };
  const EdgePixel middle = candidate(i);
  const EdgePixel before = candidate(i - normal);
  const EdgePixel after = candidate(i + normal);
  const EdgePixel side = after.strongerThan(before) ? after : before;
  const std::int32_t to_side = after.strongerThan(before) ? normal : -normal;
  const std::int32_t step = side.strongerThan(middle) ? to_side : 0;
  return {i + step, side.strongerThan(middle) ? side : middle};
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

inline void MeanDirection::add(std::uint8_t direction) {
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

/// The pixel straight ahead where the edge continues for at least two pixels, or -1.
std::int32_t EdgeChains::beyondGap(std::int32_t from, int sign, MeanDirection mean,
                                   const EdgeMap& map) const {
  const Slope& slope = slopes_[mean.value()];
  const Steps steps = stepsOf(mean.quadrant(), map.stride());
  const int max_gap = std::min(static_cast<int>(chain_.size()) / kPixelsPerGap, kMaxGap);
  for (int gap = 2; gap <= max_gap; ++gap) {
    const int dx = (slope.x * gap + kSlopeOne / 2) >> kSlopeShift;
    const int dy = (slope.y * gap + kSlopeOne / 2) >> kSlopeShift;
    const PixelAt landing =
        strongestAlongNormal(from + sign * (dx + dy * map.stride()), steps.normal, mean, map);
    if (landing.pixel &&
        strongestAlongNormal(landing.index + sign * steps.along, steps.normal, mean, map).pixel)
      return landing.index;
  }
  return -1;
}

/// The mean is a copy, which stays in registers. A pixel is found before the next one is looked
/// for: what lies between is the time that a walk takes.
void EdgeChains::walk(std::int32_t from, int sign, MeanDirection mean, EdgeMap* map) {
  int quadrant = mean.quadrant();
  Steps steps = stepsOf(quadrant, map->stride());
  for (std::int32_t here = from;;) {
    for (const std::int32_t neighbour : {here - steps.normal, here + steps.normal})
      map->eraseIf(mean.agrees((*map)[neighbour].direction()), neighbour);
    PixelAt next = strongestAlongNormal(here + sign * steps.along, steps.normal, mean, *map);
    if (!next.pixel) {
      next.index = beyondGap(here, sign, mean, *map);
      if (next.index < 0) return;
      next.pixel = (*map)[next.index];
    }
    mean.add(next.pixel.direction());
    map->erase(next.index);
    chain_.push_back(next.index);
    here = next.index;
    if (mean.quadrant() != quadrant) {  // seldom, so that the processor need not wait for the mean
      quadrant = mean.quadrant();
      steps = stepsOf(quadrant, map->stride());
    }
  }
}

const std::vector<std::int32_t>& EdgeChains::follow(std::int32_t anchor, EdgeMap* map) {
  const std::uint8_t direction = (*map)[anchor].direction();
  map->erase(anchor);
  chain_.assign(1, anchor);
  walk(anchor, -1, MeanDirection(direction), map);
  std::reverse(chain_.begin(), chain_.end());
  walk(anchor, 1, MeanDirection(direction), map);
  return chain_;
}

}  // namespace point_line_odometry
