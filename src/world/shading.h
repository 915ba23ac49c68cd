#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

#include "world/batch.h"
#include "world/sky.h"
#include "world/visible_surfaces.h"

namespace point_line_odometry::world {

/// What some rays of a pixel see of one surface, or of the sky: its light there is that of all of
/// these rays.
struct Sample {
  float* pixel = nullptr;
  cv::Point2f at;      ///< mean of the rays, in the normalised image plane
  cv::Point2f extent;  ///< of the pixel there
  float radiance = 0.0F;
  int rays = 0;
  int next = -1;  ///< sample of the same surface
};

using SampleBatch = std::array<Sample*, kBatch>;

/// Samples of some pixels, listed by the surfaces that they are of.
class Samples {
 public:
  static constexpr int kRays = 16;  // of every pixel

  explicit Samples(std::size_t num_surfaces) : first_(num_surfaces, kNone) {
    samples_.reserve(kCapacity);
  }

  bool hasRoomForPixel() const { return samples_.size() + kRays <= kCapacity; }

  void add(std::size_t surface, Sample sample) {
    if (first_[surface] == kNone) surfaces_.push_back(surface);
    sample.next = first_[surface];
    first_[surface] = static_cast<int>(samples_.size());
    samples_.push_back(sample);
  }

  /// Sets the pixels to the mean of their rays and removes the samples.
  /// \param shade called as shade(surface, batch, size) for each surface, with some of its samples,
  /// whose radiance it sets.
  template <typename Shade>
  void write(Shade&& shade) {
    for (const std::size_t surface : surfaces_) {
      SampleBatch batch;
      std::size_t size = 0;
      for (int i = first_[surface]; i != kNone; i = samples_[static_cast<std::size_t>(i)].next) {
        if (size == kBatch) {
          shade(surface, batch, size);
          size = 0;
        }
        batch[size++] = &samples_[static_cast<std::size_t>(i)];
      }
      shade(surface, batch, size);
      first_[surface] = kNone;
    }
    for (const Sample& sample : samples_) *sample.pixel = 0.0F;
    for (const Sample& sample : samples_) {
      *sample.pixel += sample.radiance * static_cast<float>(sample.rays) / kRays;
    }
    surfaces_.clear();
    samples_.clear();
  }

 private:
  static constexpr std::size_t kCapacity = 4096;  // they fit into the second-level cache
  static constexpr int kNone = -1;

  std::vector<Sample> samples_;
  std::vector<std::size_t> surfaces_;  // that have samples
  std::vector<int> first_;             // in the list of each surface: the sample added last
};

/// Sets the samples to the light of a surface where they see it.
void shadeSurface(const SeenSurface& surface, float haze_per_m, const SampleBatch& samples,
                  std::size_t size);

/// Sets the samples to the light of the sky in their directions.
void shadeSky(const Sky& sky, const Eigen::Matrix3f& R_world_camera, const SampleBatch& samples,
              std::size_t size);

}  // namespace point_line_odometry::world
