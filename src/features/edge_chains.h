#pragma once

#include <array>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "features/edge_map.h"

namespace point_line_odometry {

/// Mean direction of the gradient along the last pixels of a chain.
class MeanDirection {
 public:
  explicit MeanDirection(std::uint8_t first) : mean_(static_cast<std::uint16_t>(first << 8)) {}

  /// [1/256 of a turn]
  std::uint8_t value() const { return static_cast<std::uint8_t>((mean_ + 128) >> 8); }

  inline void add(std::uint8_t direction);

  /// 0: the gradient points to the right; 1: down.
  int quadrant() const { return ((value() + 32) >> 6) & 3; }

  /// Whether a direction is within LSD's angle tolerance, 22.5 deg, of the mean.
  bool agrees(std::uint8_t direction) const {
    return static_cast<std::uint8_t>(direction - value() + kTolerance) <= 2 * kTolerance;
  }

 private:
  static constexpr int kTolerance = 16;

  std::uint16_t mean_;  // 1/65536 of a turn
  int count_ = 1;
};

/// Follows the ridges of the gradient, pixel by pixel, into chains: the edges of the image.
class EdgeChains {
 public:
  EdgeChains();

  /// The chain through an anchor: pixels of the map, ordered so that the brighter side is on the
  /// right. They are erased from the map, and with them the neighbours that belong to the same
  /// edge.
  const std::vector<std::int32_t>& follow(std::int32_t anchor, EdgeMap* map);

 private:
  void walk(std::int32_t from, int sign, MeanDirection mean, EdgeMap* map);
  std::int32_t beyondGap(std::int32_t from, int sign, MeanDirection mean, const EdgeMap& map) const;

  struct Slope {
    int x, y;
  };
  // The edge's direction by that of its gradient, the larger side kSlopeOne.
  std::array<Slope, 256> slopes_;
  std::vector<std::int32_t> chain_;
};

}  // namespace point_line_odometry
