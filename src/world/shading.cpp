#include "world/shading.h"

#include <cmath>

#include "common/processor_clones.h"

namespace point_line_odometry::world {

POINT_LINE_ODOMETRY_CLONES("avx2")
void shadeSurface(const SeenSurface& s, float haze_per_m, const SampleBatch& samples,
                  std::size_t size) {
  Values x;
  Values y;
  Values width;
  Values height;
  for (std::size_t i = 0; i < size; ++i) {
    x[i] = samples[i]->at.x;
    y[i] = samples[i]->at.y;
    width[i] = samples[i]->extent.x;
    height[i] = samples[i]->extent.y;
  }
  PatchBatch patches;
  patches.size = size;
  Values clear;
  for (std::size_t i = 0; i < size; ++i) {
    const cv::Point2f p(x[i], y[i]);
    const float q = s.q.at(p);
    const float z = 1.0F / q;
    const float u = s.uq.at(p) * z;
    const float v = s.vq.at(p) * z;
    patches.u[i] = u;
    patches.v[i] = v;
    patches.size_u[i] = z * (std::abs((s.uq.a - u * s.q.a) * width[i]) +
                             std::abs((s.uq.b - u * s.q.b) * height[i]));
    patches.size_v[i] = z * (std::abs((s.vq.a - v * s.q.a) * width[i]) +
                             std::abs((s.vq.b - v * s.q.b) * height[i]));
    patches.slope_u[i] = (u - s.eye_u) / s.eye_height;
    patches.slope_v[i] = (v - s.eye_v) / s.eye_height;
    clear[i] = q / (q + haze_per_m);
  }
  Values reflected;
  reflectance(*s.material, patches, &reflected);
  constexpr float kHazeRadiance = 0.8F;
  for (std::size_t i = 0; i < size; ++i) {
    samples[i]->radiance = clear[i] * s.light * reflected[i] + (1.0F - clear[i]) * kHazeRadiance;
  }
}

void shadeSky(const Sky& sky, const Eigen::Matrix3f& R_world_camera, const SampleBatch& samples,
              std::size_t size) {
  RayBatch rays;
  rays.size = size;
  for (std::size_t i = 0; i < size; ++i) {
    const Eigen::Vector3f ray =
        R_world_camera * Eigen::Vector3f(samples[i]->at.x, samples[i]->at.y, 1.0F);
    rays.x[i] = ray.x();
    rays.y[i] = ray.y();
    rays.z[i] = ray.z();
  }
  Values radiance;
  skyRadiance(sky, rays, &radiance);
  for (std::size_t i = 0; i < size; ++i) samples[i]->radiance = radiance[i];
}

}  // namespace point_line_odometry::world
