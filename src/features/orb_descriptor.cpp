#include "features/orb_descriptor.h"

#include <cmath>
#include <random>

namespace point_line_odometry {
namespace {

constexpr int kPatternRadius = 13;  // of the comparisons; sqrt(2) more when rotated
constexpr double kPi = 3.14159265358979323846;

/// Approximately normal numbers from a generator that the C++ standard specifies, so that
/// descriptors are the same on every platform.
class PatternGenerator {
 public:
  /// One coordinate within the pattern. \param sigma standard deviation [px].
  double coordinate(double sigma) {
    for (;;) {
      double sum = 0.0;
      for (int i = 0; i < 12; ++i) sum += static_cast<double>(generator_()) / std::mt19937::max();
      const double value = sigma * (sum - 6.0);
      if (std::abs(value) <= kPatternRadius) return value;
    }
  }

 private:
  std::mt19937 generator_{20210409U};
};

}  // namespace

OrbDescriptor::OrbDescriptor() {
  for (int dy = 0; dy <= kRadius; ++dy) {
    const int half_width =
        static_cast<int>(std::sqrt(static_cast<float>(kRadius * kRadius - dy * dy)) + 0.5F);
    for (int column = 0; column < kColumns; ++column)
      in_radius_[dy][column] = std::abs(column - kRadius) <= half_width ? -1 : 0;
  }
  PatternGenerator generator;
  constexpr double kSigma = (2 * kRadius + 1) / 5.0;  // a fifth of the patch, as in BRIEF
  std::array<std::array<double, 4>, kBits> upright;
  for (auto& comparison : upright) {
    for (double& coordinate : comparison) coordinate = generator.coordinate(kSigma);
  }
  for (int rotation = 0; rotation < kRotations; ++rotation) {
    const double angle = 2.0 * kPi * rotation / kRotations;
    const double c = std::cos(angle);
    const double s = std::sin(angle);
    const auto turned = [c, s](double x, double y) {
      return cv::Point(static_cast<int>(std::lround(c * x - s * y)),
                       static_cast<int>(std::lround(s * x + c * y)));
    };
    for (int bit = 0; bit < kBits; ++bit) {
      const auto& comparison = upright[bit];
      patterns_[rotation][bit] = {turned(comparison[0], comparison[1]),
                                  turned(comparison[2], comparison[3])};
    }
  }
}

/// Two rows at the same distance above and below the centre are summed together; all sums fit into
/// 16 bits: 31 * 255 and 15 * 16 / 2 * 255.
float OrbDescriptor::orientation(const cv::Mat& image, cv::Point centre) const {
  std::array<std::int16_t, kColumns> sums{};          // of each column
  std::array<std::int16_t, kColumns> sums_times_y{};  // of y times brightness
  const auto step = static_cast<std::ptrdiff_t>(image.step1());
  const uchar* middle = image.ptr<uchar>(centre.y) + centre.x - kRadius;
  for (int i = 0; i < kColumns; ++i)
    sums[i] = static_cast<std::int16_t>(middle[i] & in_radius_[0][i]);
  for (int dy = 1; dy <= kRadius; ++dy) {
    const uchar* above = middle - dy * step;
    const uchar* below = middle + dy * step;
    const auto& in_radius = in_radius_[dy];
    for (int i = 0; i < kColumns; ++i) {
      const auto up = static_cast<std::int16_t>(above[i] & in_radius[i]);
      const auto down = static_cast<std::int16_t>(below[i] & in_radius[i]);
      sums[i] = static_cast<std::int16_t>(sums[i] + up + down);
      sums_times_y[i] = static_cast<std::int16_t>(sums_times_y[i] + dy * (down - up));
    }
  }
  int moment_x = 0;
  int moment_y = 0;
  for (int i = 0; i < kColumns; ++i) {
    moment_x += (i - kRadius) * sums[i];
    moment_y += sums_times_y[i];
  }
  return cv::fastAtan2(static_cast<float>(moment_y), static_cast<float>(moment_x)) *
         static_cast<float>(kPi / 180.0);
}

void OrbDescriptor::computeOffsets(std::size_t step) {
  step_ = step;
  offsets_.resize(kRotations);
  const auto offset = [step](const cv::Point& p) {
    return static_cast<std::int32_t>(p.y * static_cast<std::ptrdiff_t>(step) + p.x);
  };
  for (int rotation = 0; rotation < kRotations; ++rotation) {
    for (int bit = 0; bit < kBits; ++bit) {
      const Comparison& comparison = patterns_[rotation][bit];
      offsets_[rotation][bit] = {offset(comparison.first), offset(comparison.second)};
    }
  }
}

Descriptor OrbDescriptor::describe(const cv::Mat& smooth, cv::Point centre, float angle_rad) {
  if (smooth.step1() != step_) computeOffsets(smooth.step1());
  const int rotation =
      static_cast<int>(std::lround(angle_rad * kRotations / (2.0 * kPi))) % kRotations;
  const Offsets* offsets = offsets_[rotation].data();
  const uchar* origin = smooth.ptr<uchar>(centre.y) + centre.x;
  Descriptor descriptor{};
  for (std::uint64_t& word : descriptor) {
    for (int bit = 0; bit < 64; ++bit) {
      const bool darker = origin[offsets[bit].first] < origin[offsets[bit].second];
      word |= static_cast<std::uint64_t>(darker) << bit;
    }
    offsets += 64;
  }
  return descriptor;
}

}  // namespace point_line_odometry
