#include "matching/patch_aligner.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
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
// mean brightnesses is one of exposures only if it, or its inverse, exceeds kMinExposure, and the
// logarithm of that of the contrasts deviates from its own by less than this share of it.
constexpr float kMinExposure = 1.15F;
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

/// Ones, but for the unused last column: the product with a patch is the patch's sum.
constexpr Patch makeOnes() {
  Patch ones{};
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kSide; ++c) ones[r * kPitch + c] = 1.0F;
  }
  return ones;
}
constexpr Patch kOnes = makeOnes();

/// Mean squared deviation from a value.
float varianceOf(const Patch& values, float mean) {
  Patch deviations;
  for (std::size_t i = 0; i < values.size(); ++i) deviations[i] = (values[i] - mean) * kOnes[i];
  return dot(deviations, deviations) / kArea;
}

/// Subtracts their means from patches, and zeroes their unused last columns. Returns the means.
template <std::size_t kCount>
std::array<float, kCount> centre(const std::array<Patch*, kCount>& patches) {
  std::array<const Patch*, kCount> summands;
  std::copy(patches.begin(), patches.end(), summands.begin());
  std::array<float, kCount> means = dots(summands, kOnes);
  for (std::size_t k = 0; k < kCount; ++k) {
    means[k] /= kArea;
    for (std::size_t i = 0; i < kOnes.size(); ++i)
      (*patches[k])[i] = ((*patches[k])[i] - means[k]) * kOnes[i];
  }
  return means;
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
  const std::array<float, 3> means = centre<3>({&brightness_, &gx_, &gy_});
  mean_brightness_ = std::max(means[0], kLeastBrightness);
  mean_gx_ = means[1];
  variance_ = std::max(dot(brightness_, brightness_) / kArea, kLeastVariance);
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
    const Eigen::Vector3f products = vectorOf(dots<3>({&gx_, &gy_, &kOnes}, values));
    const float mean = products[2] / kArea;
    const float ratio = exposure(values, mean);
    const Eigen::Vector2f b = products.head<2>() / ratio - Jt_template_;
    const Eigen::Vector2f step = inverse_hessian_ * b;
    pixel -= step;
    if ((pixel - initial_px).squaredNorm() > kMaxShiftPx * kMaxShiftPx) return std::nullopt;
    if (step.squaredNorm() >= kConvergedPx * kConvergedPx) continue;
    const float rms = residual(values, mean, ratio);
    if (!(rms <= kMaxResidual)) return std::nullopt;
    return AlignedPatch{pixel, Eigen::Vector2f::Zero(), noise(rms)};
  }
  return std::nullopt;
}

float PatchAligner::exposure(const Patch& values, float mean) const {
  const float ratio = std::max(mean, kLeastBrightness) / mean_brightness_;
  if (ratio < kMinExposure && ratio > 1.0F / kMinExposure) return 1.0F;
  // Light that is added, as by glare, leaves the contrast as it is.
  const float brightness = std::log(ratio);
  const float variance = std::max(varianceOf(values, mean), kLeastVariance);
  const float contrast = 0.5F * std::log(variance / variance_);
  const float deviation = std::abs(contrast - brightness) / std::abs(brightness);
  return deviation < kMaxContrastDeviation ? ratio : 1.0F;
}

float PatchAligner::residual(const Patch& values, float mean, float exposure) const {
  Patch differences;
  for (std::size_t i = 0; i < values.size(); ++i)
    differences[i] = (values[i] - mean) * kOnes[i] / exposure - brightness_[i];
  return std::sqrt(dot(differences, differences) / kArea);
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
  centre<2>({J_slope.data(), &J_slope[1]});
  const std::array<const Patch*, 4> J{&gx_, &gy_, J_slope.data(), &J_slope[1]};
  const std::array<const Patch*, 5> J_and_ones{J[0], J[1], J[2], J[3], &kOnes};
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
    const Eigen::Matrix<float, 5, 1> products = vectorOf(dots(J_and_ones, values));
    const float mean = products[4] / kArea;
    const float ratio = exposure(values, mean);
    Eigen::Vector4f b = products.head<4>() / ratio - Jt_template;
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
    const float rms = residual(values, mean, ratio);
    if (!(rms <= kMaxSlantedResidual)) return std::nullopt;
    seen.noise_px = noise(rms);
    return seen;
  }
  return std::nullopt;
}

}  // namespace point_line_odometry
