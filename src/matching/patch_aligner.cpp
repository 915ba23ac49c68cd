#include "matching/patch_aligner.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <opencv2/core/hal/intrin.hpp>

#include "matching/patch_samples.h"

namespace point_line_odometry {
namespace {

constexpr int kSide = PatchAligner::kSide;
constexpr int kHalf = kSide / 2;
constexpr int kPitch = PatchAligner::kPitch;
constexpr int kArea = kSide * kSide;
constexpr int kMaxIterations = 8;
constexpr float kConvergedPx = 0.02F;   // size of the last step; the remaining error is far smaller
constexpr float kMaxShiftPx = 2.5F;     // from the initial pixel
constexpr float kMaxResidual = 20.0F;   // RMS of the brightness difference [grey levels]
constexpr float kLeastResidual = 1.0F;  // sensor noise

// At the edges of near things parallax changes the brightness of a patch, too: the ratio of the
// mean brightnesses is one of exposures only if its logarithm exceeds kMinLogExposure, and that of
// the contrasts deviates from it by less than this share of it.
constexpr float kMinLogExposure = 0.14F;
constexpr float kMaxContrastDeviation = 0.4F;
constexpr float kLeastBrightness = 1.0F;  // mean that is divided by [grey levels]
constexpr float kLeastVariance = 1.0F;

// Gaussian prior of the slopes about zero: its standard deviation, relative to a noise of the
// brightness [grey levels]. A patch with a larger residual than kMaxSlantedResidual is not of one
// plane.
constexpr float kSlopeDeviation = 0.2F;
constexpr float kSlopeNoise = 5.0F;
constexpr float kMaxSlantedResidual = 8.0F;  // RMS [grey levels]

using Patch = PatchAligner::Patch;

/// Products of several patches with one; a partial sum for each column, so that they are the same
/// and fast on every processor. The sums of all run side by side, as each waits for itself.
template <std::size_t kCount>
std::array<float, kCount> dots(const std::array<const Patch*, kCount>& several,
                               const Patch& values) {
  constexpr int kFours = kPitch / 4;
  std::array<std::array<cv::v_float32x4, kFours>, kCount> sums;
  for (auto& sum : sums) sum.fill(cv::v_setzero_f32());
  for (int r = 0; r < kSide * kPitch; r += kPitch) {
    for (int c = 0; c < kFours; ++c) {
      const cv::v_float32x4 value = cv::v_load(values.data() + r + 4 * c);
      for (std::size_t k = 0; k < kCount; ++k)
        sums[k][c] = sums[k][c] + cv::v_load(several[k]->data() + r + 4 * c) * value;
    }
  }
  std::array<float, kCount> products;
  for (std::size_t k = 0; k < kCount; ++k) {
    std::array<float, 4> sum;
    v_store(sum.data(), sums[k][0] + (sums[k][1] + sums[k][2]));
    products[k] = (sum[0] + sum[1]) + (sum[2] + sum[3]);
  }
  return products;
}

template <std::size_t kCount>
Eigen::Matrix<float, static_cast<int>(kCount), 1> vectorOf(const std::array<float, kCount>& a) {
  return Eigen::Matrix<float, static_cast<int>(kCount), 1>(a.data());
}

float dot(const Patch& a, const Patch& b) { return dots<1>({&a}, b)[0]; }

/// Sum of the patch by columns, the unused last one left out.
template <typename Function>
float sumOf(const Patch& values, const Function& function) {
  std::array<float, kPitch> sums{};
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kPitch; ++c) sums[c] += function(values[r * kPitch + c]);
  }
  return std::accumulate(sums.begin(), sums.begin() + kSide, 0.0F);
}

float meanOf(const Patch& values) {
  return sumOf(values, [](float value) { return value; }) / kArea;
}

float varianceOf(const Patch& values, float mean) {
  return sumOf(values, [mean](float value) { return (value - mean) * (value - mean); }) / kArea;
}

/// Subtracts the mean of the patch, and zeroes its unused last column. Returns the mean.
float centre(Patch* values) {
  const float mean = meanOf(*values);
  for (float& value : *values) value -= mean;
  for (int r = 0; r < kSide; ++r) (*values)[r * kPitch + kSide] = 0.0F;
  return mean;
}

}  // namespace

PatchAligner::PatchAligner(const cv::Mat& image, const Eigen::Vector2f& pixel) {
  if (const auto wide = sampleWidePatch(image, pixel)) prepare(*wide);
}

PatchAligner::PatchAligner(const cv::Mat& image, const Eigen::Vector2f& pixel,
                           const Eigen::Matrix2f& warp) {
  if (const auto wide = sampleWidePatch(image, pixel, warp)) prepare(*wide);
}

void PatchAligner::prepare(const WidePatch& wide) {
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kPitch; ++c) {
      const float* p = wide.data() + (r + 1) * kWidePitch + c + 1;
      brightness_[r * kPitch + c] = p[0];
      gx_[r * kPitch + c] = 0.5F * (p[1] - p[-1]);
      gy_[r * kPitch + c] = 0.5F * (p[kWidePitch] - p[-kWidePitch]);
    }
  }
  mean_brightness_ = std::max(centre(&brightness_), kLeastBrightness);
  variance_ = std::max(varianceOf(brightness_, 0.0F), kLeastVariance);
  mean_gx_ = centre(&gx_);
  centre(&gy_);
  const std::array<const Patch*, 2> J{&gx_, &gy_};
  Jt_template_ = vectorOf(dots(J, brightness_));
  hessian_ << vectorOf(dots(J, gx_)), vectorOf(dots(J, gy_));
  const float trace = hessian_.trace();
  usable_ = hessian_.determinant() > 1e-3F * trace * trace && trace > kArea;
  if (usable_) inverse_hessian_ = hessian_.inverse();
}

std::optional<AlignedPatch> PatchAligner::align(const cv::Mat& target,
                                                const Eigen::Vector2f& initial_px) const {
  if (!usable_) return std::nullopt;
  Eigen::Vector2f pixel = initial_px;
  Patch values;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (!samplePatch(target, pixel, &values)) return std::nullopt;
    // J^T (I - T). The gradients have zero mean: that of the brightness drops out.
    const float ratio = exposure(values);
    const Eigen::Vector2f b = vectorOf(dots<2>({&gx_, &gy_}, values)) / ratio - Jt_template_;
    const Eigen::Vector2f step = inverse_hessian_ * b;
    pixel -= step;
    if ((pixel - initial_px).squaredNorm() > kMaxShiftPx * kMaxShiftPx) return std::nullopt;
    if (step.squaredNorm() >= kConvergedPx * kConvergedPx) continue;
    const float rms = residual(ratio, &values);
    if (!(rms <= kMaxResidual)) return std::nullopt;
    return AlignedPatch{pixel, Eigen::Vector2f::Zero(), noise(rms)};
  }
  return std::nullopt;
}

float PatchAligner::exposure(const Patch& values) const {
  const float mean = meanOf(values);
  const float ratio = std::max(mean, kLeastBrightness) / mean_brightness_;
  const float brightness = std::log(ratio);
  if (std::abs(brightness) < kMinLogExposure) return 1.0F;
  // Light that is added, as by glare, leaves the contrast as it is.
  const float variance = std::max(varianceOf(values, mean), kLeastVariance);
  const float contrast = 0.5F * std::log(variance / variance_);
  const float deviation = std::abs(contrast - brightness) / std::abs(brightness);
  return deviation < kMaxContrastDeviation ? ratio : 1.0F;
}

float PatchAligner::residual(float exposure, Patch* values) const {
  centre(values);
  for (std::size_t i = 0; i < values->size(); ++i)
    (*values)[i] = (*values)[i] / exposure - brightness_[i];
  return std::sqrt(dot(*values, *values) / kArea);
}

double PatchAligner::noise(float residual) const {
  return std::max(residual, kLeastResidual) * std::sqrt(0.5F * inverse_hessian_.trace());
}

std::optional<AlignedPatch> PatchAligner::alignSlanted(const cv::Mat& target,
                                                       const Eigen::Vector2f& initial_px) const {
  if (!usable_) return std::nullopt;
  // Columns of the Jacobian of the brightness: by u and v, and by the two slopes.
  std::array<Patch, 2> J_slope;
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kPitch; ++c) {
      const float gx = gx_[r * kPitch + c] + mean_gx_;
      J_slope[0][r * kPitch + c] = gx * static_cast<float>(c - kHalf);
      J_slope[1][r * kPitch + c] = gx * static_cast<float>(r - kHalf);
    }
  }
  for (Patch& values : J_slope) centre(&values);
  const std::array<const Patch*, 4> J{&gx_, &gy_, J_slope.data(), &J_slope[1]};
  constexpr float kPrior = (kSlopeNoise / kSlopeDeviation) * (kSlopeNoise / kSlopeDeviation);
  Eigen::Vector4f Jt_template;
  Jt_template << Jt_template_, vectorOf(dots<2>({J_slope.data(), &J_slope[1]}, brightness_));
  Eigen::Matrix4f hessian;
  hessian.topLeftCorner<2, 2>() = hessian_;
  for (int i = 2; i < 4; ++i) hessian.col(i) = vectorOf(dots(J, *J[i]));
  hessian.bottomLeftCorner<2, 2>() = hessian.topRightCorner<2, 2>().transpose();
  hessian(2, 2) += kPrior;
  hessian(3, 3) += kPrior;
  const Eigen::Matrix4f inverse_hessian = hessian.inverse();

  AlignedPatch seen{initial_px};
  Patch values;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (!sampleSlantedPatch(target, seen, &values)) return std::nullopt;
    const float ratio = exposure(values);
    Eigen::Vector4f b = vectorOf(dots(J, values)) / ratio - Jt_template;
    b.tail<2>() += kPrior * seen.slope;
    const Eigen::Vector4f step = inverse_hessian * b;
    // Inverse compositional update: the warp so far, composed with the inverse of the step.
    const float narrowed = 1.0F / (1.0F + step[2]);
    const float along = (1.0F + seen.slope.x()) * narrowed;
    seen.slope.y() -= along * step[3];
    seen.slope.x() = along - 1.0F;
    seen.pixel.x() -= along * step[0] + seen.slope.y() * step[1];
    seen.pixel.y() -= step[1];
    if (!((seen.pixel - initial_px).squaredNorm() <= kMaxShiftPx * kMaxShiftPx &&
          seen.slope.lpNorm<Eigen::Infinity>() <= kMaxPatchSlope)) {
      return std::nullopt;
    }
    if (step.head<2>().squaredNorm() >= kConvergedPx * kConvergedPx) continue;
    const float rms = residual(ratio, &values);
    if (!(rms <= kMaxSlantedResidual)) return std::nullopt;
    seen.noise_px = noise(rms);
    return seen;
  }
  return std::nullopt;
}

}  // namespace point_line_odometry
