#pragma once

#include <algorithm>
#include <cstdint>

#include "world/random.h"

/// \file
/// What the patterns of materials and the clouds are made of, for one place at a time. All of it is
/// free of branches and tables, so that loops over many places are vectorised.
namespace point_line_odometry::world {

inline int floorToInt(float x) {
  const int i = static_cast<int>(x);
  return i - static_cast<int>(x < static_cast<float>(i));
}

inline float clampUnit(float x) { return std::min(1.0F, std::max(0.0F, x)); }

inline float blend(float a, float b, float share) { return a + (b - a) * share; }

inline std::uint32_t cellHash(std::uint32_t seed, int iu, int iv) {
  return hash(seed, static_cast<std::uint32_t>(iu), static_cast<std::uint32_t>(iv));
}

/// Smooth noise in [-1, 1] with knots at whole numbers.
inline float smoothNoise(float x, float y, std::uint32_t seed) {
  const int ix = floorToInt(x);
  const int iy = floorToInt(y);
  float fx = x - static_cast<float>(ix);
  float fy = y - static_cast<float>(iy);
  fx = fx * fx * (3.0F - 2.0F * fx);
  fy = fy * fy * (3.0F - 2.0F * fy);
  const auto knot = [=](int dx, int dy) {
    const auto bits = static_cast<int>(cellHash(seed, ix + dx, iy + dy) >> 8);
    return static_cast<float>(bits) * 0x1p-23F - 1.0F;
  };
  return blend(blend(knot(0, 0), knot(1, 0), fx), blend(knot(0, 1), knot(1, 1), fx), fy);
}

}  // namespace point_line_odometry::world
