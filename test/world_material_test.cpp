#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "world/material.h"
#include "world/random.h"
#include "world/sky.h"

namespace point_line_odometry::world {
namespace {

struct Patch {
  float u;
  float v;
  float size;
  float slope_u = 0.0F;
};

Patch patchAt(float u, float v, float size) { return {u, v, size}; }

void add(const Patch& patch, PatchBatch* batch) {
  const std::size_t i = batch->size++;
  batch->u[i] = patch.u;
  batch->v[i] = patch.v;
  batch->size_u[i] = batch->size_v[i] = patch.size;
  batch->slope_u[i] = patch.slope_u;
  batch->slope_v[i] = 0.0F;
}

float reflectance(const Material& m, const Patch& patch) {
  PatchBatch batch;
  add(patch, &batch);
  Values out;
  reflectance(m, batch, &out);
  return out[0];
}

Material material(Pattern pattern) {
  Random random(3);
  return makeMaterial(pattern, 0.5, 0.3, {0.24, 0.32}, &random);
}

const Pattern kPatterns[] = {Pattern::kPlain, Pattern::kRough,  Pattern::kBricks,
                             Pattern::kTiles, Pattern::kPanels, Pattern::kPicture,
                             Pattern::kShelf, Pattern::kLeaves, Pattern::kSpots};

/// Mean of a fine grid of small patches over a square.
float meanOfFinePatches(const Material& m, float u, float v, float size) {
  constexpr int kSteps = 40;
  float sum = 0.0F;
  for (int i = 0; i < kSteps; ++i) {
    for (int j = 0; j < kSteps; ++j) {
      const float step = size / kSteps;
      sum += reflectance(m, patchAt(u - 0.5F * size + (static_cast<float>(i) + 0.5F) * step,
                                    v - 0.5F * size + (static_cast<float>(j) + 0.5F) * step, step));
    }
  }
  return sum / (kSteps * kSteps);
}

TEST(Material, IsAFunctionOfPositionAndSeed) {
  for (const Pattern pattern : kPatterns) {
    Material m = material(pattern);
    const float first = reflectance(m, patchAt(0.13F, 0.11F, 0.002F));
    EXPECT_EQ(first, reflectance(m, patchAt(0.13F, 0.11F, 0.002F)));
    int different = 0;
    for (std::uint32_t seed = 100; seed < 120; ++seed) {
      m.seed = seed;
      different += reflectance(m, patchAt(0.13F, 0.11F, 0.002F)) != first ? 1 : 0;
    }
    EXPECT_GT(different, 10) << static_cast<int>(pattern);
  }
}

/// Near and far ones, so that some structures are visible in a part of the batch only.
TEST(Material, OfABatchIsThatOfEachPatch) {
  Random random(5);
  for (const Pattern pattern : kPatterns) {
    for (const float pitch : {0.0F, 3.0F}) {
      Material m = material(pattern);
      m.windows.pitch_u = pitch;
      for (const std::size_t size : {std::size_t{1}, std::size_t{13}, kBatch}) {
        std::vector<Patch> patches;
        PatchBatch batch;
        for (std::size_t i = 0; i < size; ++i) {
          const double range = std::exp2(random.uniform(0.0, 20.0));
          patches.push_back({static_cast<float>(random.uniform(-range, range)),
                             static_cast<float>(random.uniform(-range, range)),
                             static_cast<float>(std::exp2(random.uniform(-9.0, 5.0))),
                             static_cast<float>(random.uniform(-1.0, 1.0))});
          add(patches.back(), &batch);
        }
        Values together;
        reflectance(m, batch, &together);
        for (std::size_t i = 0; i < size; ++i) {
          EXPECT_EQ(together[i], reflectance(m, patches[i])) << static_cast<int>(pattern);
        }
      }
    }
  }
}

TEST(Material, StaysWithinWhatASurfaceCanReflect) {
  Random random(1);
  for (const Pattern pattern : kPatterns) {
    const Material m = material(pattern);
    for (int i = 0; i < 3000; ++i) {
      const auto u = static_cast<float>(random.uniform(-20.0, 20.0));
      const auto v = static_cast<float>(random.uniform(-20.0, 20.0));
      const auto size = static_cast<float>(std::exp2(random.uniform(-9.0, 5.0)));
      const float value = reflectance(m, patchAt(u, v, size));
      ASSERT_GE(value, 0.0F) << static_cast<int>(pattern);
      ASSERT_LE(value, 1.2F) << static_cast<int>(pattern);
    }
  }
}

// Anti-aliasing: a pixel that sees a large patch gets the mean of what is in it.
TEST(Material, LargePatchIsTheMeanOfSmallOnes) {
  for (const Pattern pattern : kPatterns) {
    const Material m = material(pattern);
    double error = 0.0;
    double variation = 0.0;
    constexpr int kPlaces = 40;
    Random random(5);
    for (int i = 0; i < kPlaces; ++i) {
      const auto u = static_cast<float>(random.uniform(0.05, 3.0));
      const auto v = static_cast<float>(random.uniform(0.05, 3.0));
      const float mean = meanOfFinePatches(m, u, v, 0.4F);
      error += std::pow(reflectance(m, patchAt(u, v, 0.4F)) - mean, 2);
      variation += std::pow(reflectance(m, patchAt(u, v, 0.002F)) - mean, 2);
    }
    // What remains of the pattern at a patch as large as its elements, over its whole contrast.
    EXPECT_LT(std::sqrt(error / kPlaces), 0.05) << static_cast<int>(pattern);
    EXPECT_LT(error, 0.5 * variation + 1e-4) << static_cast<int>(pattern);
  }
}

TEST(Material, ChangesSmoothlyWithSizeAndPositionOfThePatch) {
  for (const Pattern pattern : kPatterns) {
    const Material m = material(pattern);
    constexpr float kSize = 0.05F;
    float before = reflectance(m, patchAt(0.3F, 0.4F, kSize));
    for (int i = 1; i < 2000; ++i) {  // steps of 2 % of a pixel
      const float now = reflectance(m, patchAt(0.3F + 0.001F * static_cast<float>(i), 0.4F, kSize));
      ASSERT_LT(std::abs(now - before), 0.05F) << static_cast<int>(pattern) << " at step " << i;
      before = now;
    }
  }
}

// Descriptors at different positions are not equal by accident.
TEST(Material, DoesNotRepeat) {
  for (const Pattern pattern :
       {Pattern::kRough, Pattern::kBricks, Pattern::kLeaves, Pattern::kSpots}) {
    const Material m = material(pattern);
    std::set<std::vector<int>> seen;
    int windows = 0;
    for (int i = 0; i < 200; ++i) {
      for (int j = 0; j < 20; ++j) {
        std::vector<int> window;
        for (int k = 0; k < 49; ++k) {
          const float u = 0.48F * static_cast<float>(i) + 0.02F * static_cast<float>(k % 7);
          const float v = 0.64F * static_cast<float>(j) + 0.02F * static_cast<float>(k / 7);
          window.push_back(static_cast<int>(64.0F * reflectance(m, patchAt(u, v, 0.02F))));
        }
        seen.insert(window);
        ++windows;
      }
    }
    EXPECT_EQ(static_cast<int>(seen.size()), windows) << static_cast<int>(pattern);
  }
}

TEST(Material, RepeatsAfterTheLengthThatIsGiven) {
  constexpr float kLength = 0.5F;
  for (const Pattern pattern : kPatterns) {
    Material m = material(pattern);
    m.repetition = kLength;
    int different = 0;
    for (int i = 0; i < 25; ++i) {
      const float u = 0.02F * static_cast<float>(i);
      const float once = reflectance(m, patchAt(u, 0.3F, 0.005F));
      for (const float lengths : {-3.0F, 1.0F, 40.0F}) {
        EXPECT_NEAR(reflectance(m, patchAt(u + lengths * kLength, 0.3F, 0.005F)), once, 2e-3F)
            << static_cast<int>(pattern);
        EXPECT_NEAR(reflectance(m, patchAt(u, 0.3F + lengths * kLength, 0.005F)), once, 2e-3F)
            << static_cast<int>(pattern);
      }
      different += reflectance(m, patchAt(u, 0.05F, 0.005F)) != once ? 1 : 0;
    }
    EXPECT_GT(different, 10) << static_cast<int>(pattern);
  }
}

/// Variance of the means over squares of a size, over the variance of the pattern itself, both
/// around the mean of half a metre.
double shareLeftInMeans(const Material& m, float size) {
  double of_means = 0.0;
  double of_pattern = 0.0;
  Random random(8);
  constexpr int kPlaces = 400;
  for (int i = 0; i < kPlaces; ++i) {
    const auto u = static_cast<float>(random.uniform(-30.0, 30.0));
    const auto v = static_cast<float>(random.uniform(-30.0, 30.0));
    const float mean = meanOfFinePatches(m, u, v, 0.5F);
    of_means += std::pow(meanOfFinePatches(m, u, v, size) - mean, 2);
    of_pattern += std::pow(reflectance(m, patchAt(u, v, 0.001F)) - mean, 2);
  }
  return of_means / of_pattern;
}

TEST(Spots, AreSoftAnd3To20CentimetresWide) {
  Material m = material(Pattern::kSpots);
  const double within_spots = shareLeftInMeans(m, 0.015F);
  const double across_spots = shareLeftInMeans(m, 0.15F);
  EXPECT_GT(within_spots, 0.85);
  EXPECT_LT(across_spots, 0.3);
  float steepest = 0.0F;  // per millimetre
  for (int i = 0; i < 20000; ++i) {
    const float u = 0.001F * static_cast<float>(i);
    steepest = std::max(steepest, std::abs(reflectance(m, patchAt(u, 0.7F, 0.001F)) -
                                           reflectance(m, patchAt(u + 0.001F, 0.7F, 0.001F))));
  }
  EXPECT_LT(steepest, 0.15F * m.albedo * m.contrast);
}

TEST(Windows, ARecessShowsItsSideToASlantingRay) {
  Material m = material(Pattern::kPlain);
  m.contrast = 0.0F;
  m.windows.pitch_u = 3.0F;
  m.windows.recess = 0.2F;
  const float left_edge = 0.5F * (m.windows.pitch_u - m.windows.width);
  Patch patch = patchAt(left_edge + 0.05F, m.windows.sill + 0.7F, 0.001F);
  const float straight = reflectance(m, patch);  // the frame of the window
  patch.slope_u = -1.0F;                         // leaves the opening at the left: its side is seen
  const float side = reflectance(m, patch);
  EXPECT_NEAR(side, 0.65F * m.albedo, 1e-3F);
  EXPECT_GT(std::abs(side - straight), 0.2F);
  patch.u = left_edge - 0.05F;  // next to the opening: the wall, from every side
  EXPECT_NEAR(reflectance(m, patch), m.albedo, 1e-3F);
}

TEST(Sky, IsBrightAndSmooth) {
  float low = 1.0F;
  float high = 0.0F;
  RayBatch ray;
  ray.size = 1;
  for (int i = 0; i < 360; ++i) {
    const auto angle = static_cast<float>(i * kPi / 180.0);
    ray.x[0] = std::cos(angle);
    ray.y[0] = std::sin(angle);
    ray.z[0] = 0.2F;
    Values radiance;
    skyRadiance({7, 0.0F}, ray, &radiance);
    low = std::min(low, radiance[0]);
    high = std::max(high, radiance[0]);
  }
  EXPECT_GT(low, 0.7F);
  EXPECT_LT(high, 1.0F);
}

}  // namespace
}  // namespace point_line_odometry::world
