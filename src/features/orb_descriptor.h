#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "features/features.h"

namespace point_line_odometry {

/// Orientation and descriptor of ORB (Rublee et al. 2011) with a pattern of our own: rotated BRIEF
/// comparisons drawn from a normal distribution (Calonder et al. 2010).
class OrbDescriptor {
 public:
  static constexpr int kBorder = 20;  ///< pixels around a keypoint that are read

  OrbDescriptor();

  /// Orientation by the intensity centroid of a disc of radius 15 [rad], 0 ... 2 pi.
  float orientation(const cv::Mat& image, cv::Point centre) const;

  /// \param smooth the image after a Gaussian; \param angle_rad the keypoint's orientation.
  Descriptor describe(const cv::Mat& smooth, cv::Point centre, float angle_rad);

 private:
  static constexpr int kRadius = 15;
  static constexpr int kColumns = 32;  // the disc's diameter + 1
  static constexpr int kRotations = 30;
  static constexpr int kBits = 256;

  struct Comparison {
    cv::Point first;
    cv::Point second;
  };
  /// Memory offsets from the centre to the two pixels.
  struct Offsets {
    std::int32_t first;
    std::int32_t second;
  };

  void computeOffsets(std::size_t step);

  std::array<std::array<std::int16_t, kColumns>, kRadius + 1>
      in_radius_;                                                   // -1 or 0, by |dy| and dx
  std::array<std::array<Comparison, kBits>, kRotations> patterns_;  // in steps of 12 deg
  std::size_t step_ = 0;                             // of the image that offsets_ are for
  std::vector<std::array<Offsets, kBits>> offsets_;  // by rotation
};

}  // namespace point_line_odometry
