#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "matching/patch_samples.h"
#include "point_line_odometry/matching.h"

namespace point_line_odometry {
namespace {

constexpr int kSide = PatchAligner::kSide;
constexpr int kHalf = kSide / 2;
constexpr int kPitch = PatchAligner::kPitch;
constexpr int kArea = kSide * kSide;
constexpr int kWide = PatchAligner::kWide;
constexpr int kMaxIterations = 8;
constexpr float kConvergedPx = 0.02F;   // size of the last step: what is left is far smaller
constexpr float kMaxShiftPx = 2.5F;     // from the initial place
constexpr float kMaxResidual = 20.0F;   // RMS of the brightness difference [grey levels]
constexpr float kLeastResidual = 1.0F;  // no camera explains its brightness better

// Slopes are taken to be about zero where the patch does not show them: so much, for a brightness
// that is known so well [grey levels]. A patch that slopes do not explain so well shows more than
// one surface.
constexpr float kSlopeDeviation = 0.2F;
constexpr float kSlopeNoise = 5.0F;
constexpr float kMaxSlantedResidual = 8.0F;  // RMS, as above

using Patch = PatchAligner::Patch;

/// Sum of products; a partial sum for each column, so that it is the same and fast on every
/// processor.
float dot(const Patch& a, const Patch& b) {
  std::array<float, kPitch> sums{};
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kPitch; ++c) sums[c] += a[r * kPitch + c] * b[r * kPitch + c];
  }
  for (int c = 0; c < 4; ++c) sums[c] += sums[c + 4] + sums[c + 8];
  return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

/// The same of several patches with one.
template <std::size_t kCount>
Eigen::Matrix<float, static_cast<int>(kCount), 1> dots(
    const std::array<const Patch*, kCount>& several, const Patch& values) {
  Eigen::Matrix<float, static_cast<int>(kCount), 1> products;
  for (std::size_t i = 0; i < kCount; ++i) products[static_cast<int>(i)] = dot(*several[i], values);
  return products;
}

/// Makes the mean of the patch zero, and its last column. Returns what the mean was.
float centre(Patch* values) {
  std::array<float, kPitch> sums{};
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kPitch; ++c) sums[c] += (*values)[r * kPitch + c];
  }
  const float mean = std::accumulate(sums.begin(), sums.begin() + kSide, 0.0F) / kArea;
  for (float& value : *values) value -= mean;
  for (int r = 0; r < kSide; ++r) (*values)[r * kPitch + kSide] = 0.0F;
  return mean;
}

}  // namespace

PatchAligner::PatchAligner(const cv::Mat& image, const Eigen::Vector2f& pixel) {
  if (const auto wide = sampleWidePatch(image, pixel)) prepare(*wide);
}

PatchAligner::PatchAligner(const cv::Mat& image, const Eigen::Vector2f& pixel,
                           const Eigen::Matrix2f& source_by_target) {
  if (const auto wide = sampleWidePatch(image, pixel, source_by_target)) prepare(*wide);
}

void PatchAligner::prepare(const WidePatch& wide) {
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kPitch; ++c) {
      const float* p = wide.data() + (r + 1) * kWide + c + 1;
      brightness_[r * kPitch + c] = p[0];
      gx_[r * kPitch + c] = 0.5F * (p[1] - p[-1]);
      gy_[r * kPitch + c] = 0.5F * (p[kWide] - p[-kWide]);
    }
  }
  centre(&brightness_);
  mean_gx_ = centre(&gx_);
  centre(&gy_);
  at_brightness_ = dots<2>({&gx_, &gy_}, brightness_);
  Eigen::Matrix2f hessian;
  const float xy = dot(gx_, gy_);
  hessian << dot(gx_, gx_), xy, xy, dot(gy_, gy_);
  const float trace = hessian.trace();
  usable_ = hessian.determinant() > 1e-3F * trace * trace && trace > kArea;
  if (usable_) inverse_hessian_ = hessian.inverse();
}

std::optional<AlignedPatch> PatchAligner::align(const cv::Mat& target,
                                                const Eigen::Vector2f& initial_px) const {
  if (!usable_) return std::nullopt;
  Eigen::Vector2f pixel = initial_px;
  Patch values;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (!samplePatch(target, pixel, &values)) return std::nullopt;
    // The gradients have no mean: that of the brightness drops out of the products.
    const Eigen::Vector2f b = dots<2>({&gx_, &gy_}, values) - at_brightness_;
    const Eigen::Vector2f step = inverse_hessian_ * b;
    pixel -= step;
    if ((pixel - initial_px).squaredNorm() > kMaxShiftPx * kMaxShiftPx) return std::nullopt;
    if (step.squaredNorm() >= kConvergedPx * kConvergedPx) continue;
    const float left_over = residual(&values);
    if (!(left_over <= kMaxResidual)) return std::nullopt;
    return AlignedPatch{pixel, Eigen::Vector2f::Zero(), noise(left_over)};
  }
  return std::nullopt;
}

float PatchAligner::residual(Patch* values) const {
  centre(values);
  for (std::size_t i = 0; i < values->size(); ++i) (*values)[i] -= brightness_[i];
  return std::sqrt(dot(*values, *values) / kArea);
}

double PatchAligner::noise(float residual) const {
  return std::max(residual, kLeastResidual) * std::sqrt(0.5F * inverse_hessian_.trace());
}

std::optional<AlignedPatch> PatchAligner::alignSlanted(const cv::Mat& target,
                                                       const Eigen::Vector2f& initial_px) const {
  if (!usable_) return std::nullopt;
  // What the brightness changes by: along the two directions, and with the two slopes.
  std::array<Patch, 2> by_slope;
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kPitch; ++c) {
      const float gx = gx_[r * kPitch + c] + mean_gx_;
      by_slope[0][r * kPitch + c] = gx * static_cast<float>(c - kHalf);
      by_slope[1][r * kPitch + c] = gx * static_cast<float>(r - kHalf);
    }
  }
  for (Patch& values : by_slope) centre(&values);
  const std::array<const Patch*, 4> by{&gx_, &gy_, by_slope.data(), &by_slope[1]};
  constexpr float kPrior = (kSlopeNoise / kSlopeDeviation) * (kSlopeNoise / kSlopeDeviation);
  const Eigen::Vector4f at_brightness = dots(by, brightness_);
  Eigen::Matrix4f hessian;
  for (int i = 0; i < 4; ++i) {
    for (int k = 0; k <= i; ++k) hessian(i, k) = hessian(k, i) = dot(*by[i], *by[k]);
  }
  hessian(2, 2) += kPrior;
  hessian(3, 3) += kPrior;
  const Eigen::Matrix4f inverse_hessian = hessian.inverse();

  AlignedPatch seen{initial_px};
  Patch values;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (!sampleSlantedPatch(target, seen, &values)) return std::nullopt;
    Eigen::Vector4f b = dots(by, values) - at_brightness;
    b.tail<2>() += kPrior * seen.slope;
    const Eigen::Vector4f step = inverse_hessian * b;
    // The patch as seen before, after the inverse of the step.
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
    const float left_over = residual(&values);
    if (!(left_over <= kMaxSlantedResidual)) return std::nullopt;
    seen.noise_px = noise(left_over);
    return seen;
  }
  return std::nullopt;
}

}  // namespace point_line_odometry
