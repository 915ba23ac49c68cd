#include "motion/noise_scale.h"

#include <gtest/gtest.h>

#include <cmath>

#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

/// Residuals of a variance, whitened by the standard deviations of the scale.
ResidualHistogram residuals(int size, double variance, double scale, synthetic::Random* random) {
  ResidualHistogram histogram;
  for (int i = 0; i < size; ++i) histogram.add(random->normal(std::sqrt(variance / scale)));
  return histogram;
}

TEST(NoiseScale, EstimatesTheVarianceOfEachKind) {
  synthetic::Random random(1);
  NoiseScale noise;
  double points = 0.0;
  double lines = 0.0;
  constexpr int kFrames = 400;
  constexpr int kLast = 200;
  for (int i = 0; i < kFrames; ++i) {
    const auto of_lines = residuals(100, 0.4, noise.line_variance, &random);
    const auto of_points = residuals(600, 2.5, noise.point_variance, &random);
    noise.update(of_points, of_lines);
    if (i < kFrames - kLast) continue;
    points += noise.point_variance / kLast;
    lines += noise.line_variance / kLast;
  }
  EXPECT_NEAR(points, 2.5, 0.05);
  EXPECT_NEAR(lines, 0.4, 0.02);
}

TEST(NoiseScale, AFrameWithFewResidualsHasASmallWeight) {
  synthetic::Random random(2);
  NoiseScale few;
  NoiseScale many;
  few.update(residuals(6, 9.0, 1.0, &random), {});
  many.update(residuals(600, 9.0, 1.0, &random), {});
  EXPECT_LT(std::abs(few.point_variance - 1.0), 0.1);
  EXPECT_GT(many.point_variance, 1.2);
  EXPECT_EQ(many.line_variance, 1.0);
}

TEST(NoiseScale, StaysWithinBounds) {
  NoiseScale noise;
  ResidualHistogram huge;
  ResidualHistogram none_left;
  for (int i = 0; i < 500; ++i) huge.add(1e6);
  for (int i = 0; i < 500; ++i) none_left.add(0.0);
  for (int i = 0; i < 1000; ++i) noise.update(huge, none_left);
  EXPECT_EQ(noise.point_variance, 4.0);
  EXPECT_EQ(noise.line_variance, 0.25);
  for (int i = 0; i < 1000; ++i) noise.update(none_left, huge);
  EXPECT_EQ(noise.point_variance, 0.25);
  EXPECT_EQ(noise.line_variance, 4.0);
}

}  // namespace
}  // namespace point_line_odometry
