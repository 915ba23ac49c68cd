#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>

namespace point_line_odometry {

/// A patch aligned in another image: offset (x, y) of the patch is at column pixel.x + (1 +
/// slope.x) x + slope.y y and row pixel.y + y.
struct AlignedPatch {
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< its centre
  Eigen::Vector2f slope = Eigen::Vector2f::Zero();
  /// Standard deviation of each coordinate, from the residual of the brightness and the gradients;
  /// before alignment that of rounding to a whole pixel.
  double noise_px = std::sqrt(1.0 / 12.0);
};

/// Aligns the patch around a pixel of one image, 11 x 11 px, with others by translation (inverse
/// compositional Lucas-Kanade with the mean brightness removed). The other image may be exposed
/// differently: where both brightness and contrast of its patch say so, it is divided by the ratio
/// of the mean brightnesses.
class PatchAligner {
 public:
  static constexpr int kSide = 11;
  static constexpr int kPitch = 12;        ///< of rows in memory: the last column is unused
  static constexpr int kWide = kSide + 2;  ///< with a border for the gradients
  static constexpr int kWidePitch = 16;
  using Patch = std::array<float, kSide * kPitch>;
  using WidePatch = std::array<float, kWide * kWidePitch>;

  /// \param image CV_8UC1. \param pixel centre of the patch.
  PatchAligner(const cv::Mat& image, const Eigen::Vector2f& pixel);

  /// The patch in another view.
  /// \param warp Jacobian of the image's pixels by the patch's pixels.
  PatchAligner(const cv::Mat& image, const Eigen::Vector2f& pixel, const Eigen::Matrix2f& warp);

  /// The patch in the target, without slopes. Nothing if it does not converge near the initial
  /// pixel, the patches differ, or the gradients of the patch have one direction only.
  std::optional<AlignedPatch> align(const cv::Mat& target, const Eigen::Vector2f& initial_px) const;

  /// The same for a patch of the left image of a rectified pair in the right one, of a plane that
  /// need not be parallel to the images: the patch is scaled and sheared horizontally, as on roads
  /// and walls. Nothing, too, if the patch is not of one plane.
  std::optional<AlignedPatch> alignSlanted(const cv::Mat& target,
                                           const Eigen::Vector2f& initial_px) const;

 private:
  void prepare(const WidePatch& wide);
  float exposure(const Patch& values) const;            // relative to that of this patch
  float residual(float exposure, Patch* values) const;  // RMS [grey levels]; spoils the values
  double noise(float residual) const;                   // of a coordinate [px]

  Patch brightness_;  // each less its mean
  Patch gx_;
  Patch gy_;
  float mean_brightness_ = 1.0F;
  float variance_ = 1.0F;  // of the brightness
  float mean_gx_ = 0.0F;
  Eigen::Vector2f Jt_template_;  // products of the gradients and the brightness
  Eigen::Matrix2f hessian_ = Eigen::Matrix2f::Zero();
  Eigen::Matrix2f inverse_hessian_ = Eigen::Matrix2f::Zero();
  bool usable_ = false;
};

}  // namespace point_line_odometry
