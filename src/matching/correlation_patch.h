#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace point_line_odometry {

/// A patch of one image, 16 x 16 px, that is searched in others by zero-mean normalised
/// cross-correlation (ZNCC). In the dark, noise changes the comparisons of a binary descriptor; the
/// correlation of all pixels averages it out.
class CorrelationPatch {
 public:
  static constexpr int kSide = 16;

  /// \param image CV_8UC1. \param pixel centre of the patch; rounded to whole pixels.
  CorrelationPatch(const cv::Mat& image, const Eigen::Vector2f& pixel);

  /// The position of the patch among those centred in a window of another image, interpolated to
  /// sub-pixels, as the position of `pixel`. Nothing if no correlation reaches kMinCorrelation.
  /// \param window what lies outside of the image is left out.
  std::optional<Eigen::Vector2f> find(const cv::Mat& image,
                                      const Eigen::AlignedBox2f& window) const;

  /// The best of several hundred positions of pure noise reaches 0.25.
  static constexpr float kMinCorrelation = 0.4F;

 private:
  /// At all centres of a window, row by row; 0 where they are negative.
  std::vector<float> correlations(const cv::Mat& image, const Eigen::Vector2i& first,
                                  const Eigen::Vector2i& last) const;

  std::array<std::int16_t, kSide * kSide> values_{};
  int sum_ = 0;
  float norm_ = 0.0F;  // of the values less their mean, times kSide; 0 if the patch is not usable
  Eigen::Vector2f fraction_ = Eigen::Vector2f::Zero();  // pixel less its rounding
};

}  // namespace point_line_odometry
