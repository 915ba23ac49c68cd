#include "world/sky.h"

#include <cmath>

#include "common/processor_clones.h"
#include "world/noise.h"

namespace point_line_odometry::world {
namespace {

inline float noise(float x, float y, float size, std::uint32_t seed) {
  return smoothNoise(x / size, y / size, seed);
}

inline float distanceToAxis(float x, float y) { return std::sqrt(x * x + y * y) + 1e-6F; }

inline float heightOf(float z, float level) { return clampUnit(z / level); }

inline float mist(const Sky& sky, float x, float y, float z) {
  const float level = distanceToAxis(x, y);
  const float height = heightOf(z, level);
  const float east = 2.0F * x / level + 0.7F * height;
  const float north = 2.0F * y / level - 0.4F * height;
  const float density =
      0.05F * noise(east, north, 0.35F, sky.seed) + 0.03F * noise(east, north, 0.12F, sky.seed + 1);
  return 0.86F - 0.12F * height + 2.0F * density * height;
}

/// What gaps between clouds take of the light.
inline float gaps(const Sky& sky, float x, float y, float z) {
  const float level = distanceToAxis(x, y);
  const float height = heightOf(z, level);
  const float distance = 1.0F / (height + 0.2F);  // to a layer of clouds
  const float east = distance * x / level;
  const float north = distance * y / level;
  const float density = noise(east, north, 1.2F, sky.seed + 2) +
                        0.5F * noise(east, north, 0.45F, sky.seed + 3) +
                        0.3F * noise(east, north, 0.17F, sky.seed + 4) +
                        0.2F * noise(east, north, 0.07F, sky.seed + 5);
  const float cloud = clampUnit(0.45F + 1.1F * density);
  return 0.3F * sky.clouds * (1.0F - cloud) * clampUnit(6.0F * height);
}

}  // namespace

POINT_LINE_ODOMETRY_CLONES("avx2")
void skyRadiance(const Sky& sky, const RayBatch& rays, Values* out) {
  for (std::size_t i = 0; i < rays.size; ++i) {
    (*out)[i] = mist(sky, rays.x[i], rays.y[i], rays.z[i]);
  }
  if (sky.clouds <= 0.0F) return;
  for (std::size_t i = 0; i < rays.size; ++i) {
    (*out)[i] -= gaps(sky, rays.x[i], rays.y[i], rays.z[i]);
  }
}

}  // namespace point_line_odometry::world
