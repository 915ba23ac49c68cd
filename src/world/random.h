#pragma once

#include <cstdint>

namespace point_line_odometry::world {

constexpr double kPi = 3.14159265358979323846;

/// Well-mixed 32 bits of a number.
inline std::uint32_t mix(std::uint32_t x) {
  x ^= x >> 16;
  x *= 0x7feb352dU;
  x ^= x >> 15;
  x *= 0x846ca68bU;
  x ^= x >> 16;
  return x;
}

inline std::uint32_t hash(std::uint32_t seed, std::uint32_t a, std::uint32_t b = 0) {
  return mix(seed ^ (a * 0x9e3779b1U) ^ (b * 0x85ebca77U));
}

/// Byte `index` (0 ... 3) of a hash as a number in [0, 1).
inline float unit(std::uint32_t hash, int index) {
  return static_cast<float>(static_cast<int>((hash >> (8 * index)) & 0xffU)) * (1.0F / 256.0F);
}

/// Numbers in the order of the calls, the same on every platform (std's distributions are not).
class Random {
 public:
  explicit Random(std::uint32_t seed) : state_(seed) {}

  std::uint32_t bits() { return mix(state_ += 0x9e3779b9U); }

  double uniform(double from, double to) { return from + (to - from) * (bits() * 0x1p-32); }

  /// Whole number from `from` to `to`, both included.
  int integer(int from, int to) {
    return from + static_cast<int>(bits() % static_cast<std::uint32_t>(to - from + 1));
  }

  /// Approximately normal with variance 1: the sum of twelve uniform numbers.
  double gaussian() {
    double sum = -6.0;
    for (int i = 0; i < 12; ++i) sum += uniform(0.0, 1.0);
    return sum;
  }

  bool chance(double probability) { return uniform(0.0, 1.0) < probability; }

 private:
  std::uint32_t state_;
};

}  // namespace point_line_odometry::world
