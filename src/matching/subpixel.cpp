#include <algorithm>
#include <array>
#include <cmath>

#include "point_line_odometry/matching.h"

namespace point_line_odometry {
namespace {

constexpr int kRadius = 5;
constexpr int kSide = 2 * kRadius + 1;
constexpr int kArea = kSide * kSide;
constexpr int kMaxIterations = 8;
constexpr float kConvergedPx = 0.01F;
constexpr float kMaxShiftPx = 2.5F;    // from the initial place
constexpr float kMaxResidual = 20.0F;  // RMS of the brightness difference [grey levels]

/// Pixel weights of bilinear interpolation at a place; valid if the whole patch and one pixel round
/// it lie in the image.
struct Sampler {
  const uchar* origin = nullptr;  // top-left pixel of the patch
  std::size_t step = 0;
  float w00 = 0.0F, w01 = 0.0F, w10 = 0.0F, w11 = 0.0F;
  bool valid = false;

  Sampler(const cv::Mat& image, const Eigen::Vector2f& centre, int radius) {
    // In floats: no int holds NaN or a huge place.
    const auto r = static_cast<float>(radius);
    valid = centre.x() >= r && centre.y() >= r &&
            centre.x() + r + 1.0F < static_cast<float>(image.cols) &&
            centre.y() + r + 1.0F < static_cast<float>(image.rows);
    if (!valid) return;
    const int x = static_cast<int>(centre.x());
    const int y = static_cast<int>(centre.y());
    const float a = centre.x() - static_cast<float>(x);
    const float b = centre.y() - static_cast<float>(y);
    w00 = (1.0F - a) * (1.0F - b);
    w01 = a * (1.0F - b);
    w10 = (1.0F - a) * b;
    w11 = a * b;
    step = image.step1();
    origin = image.ptr<uchar>(y - radius) + (x - radius);
  }

  template <std::size_t kCount>
  void sample(int side, std::array<float, kCount>* values) const {
    for (int r = 0; r < side; ++r) {
      const uchar* p = origin + r * step;
      const uchar* q = p + step;
      float* out = values->data() + r * side;
      for (int c = 0; c < side; ++c) {
        out[c] = w00 * p[c] + w01 * p[c + 1] + w10 * q[c] + w11 * q[c + 1];
      }
    }
  }
};

float mean(const std::array<float, kArea>& values) {
  float sum = 0.0F;
  for (const float value : values) sum += value;
  return sum / kArea;
}

/// Patch of the reference image: brightness less its mean, gradient less its mean, and the inverse
/// of the normal matrix.
struct Template {
  std::array<float, kArea> brightness;
  std::array<float, kArea> gx;
  std::array<float, kArea> gy;
  Eigen::Matrix2f inverse_hessian;
  bool valid = false;

  Template(const cv::Mat& image, const Eigen::Vector2f& centre) {
    constexpr int kWide = kSide + 2;
    const Sampler sampler(image, centre, kRadius + 1);
    if (!sampler.valid) return;
    std::array<float, kWide * kWide> wide;
    sampler.sample(kWide, &wide);
    for (int r = 0; r < kSide; ++r) {
      for (int c = 0; c < kSide; ++c) {
        const float* p = wide.data() + (r + 1) * kWide + c + 1;
        brightness[r * kSide + c] = p[0];
        gx[r * kSide + c] = 0.5F * (p[1] - p[-1]);
        gy[r * kSide + c] = 0.5F * (p[kWide] - p[-kWide]);
      }
    }
    for (std::array<float, kArea>* values : {&brightness, &gx, &gy}) {
      const float average = mean(*values);
      for (float& value : *values) value -= average;
    }
    Eigen::Matrix2f hessian = Eigen::Matrix2f::Zero();
    for (int i = 0; i < kArea; ++i) {
      hessian(0, 0) += gx[i] * gx[i];
      hessian(0, 1) += gx[i] * gy[i];
      hessian(1, 1) += gy[i] * gy[i];
    }
    hessian(1, 0) = hessian(0, 1);
    const float determinant = hessian.determinant();
    valid = determinant > 1e-3F * hessian.trace() * hessian.trace() && hessian.trace() > kArea;
    if (valid) inverse_hessian = hessian.inverse();
  }
};

}  // namespace

std::optional<Eigen::Vector2f> alignPatch(const cv::Mat& reference,
                                          const Eigen::Vector2f& reference_px,
                                          const cv::Mat& target,
                                          const Eigen::Vector2f& initial_px) {
  const Template patch(reference, reference_px);
  if (!patch.valid) return std::nullopt;
  Eigen::Vector2f pixel = initial_px;
  std::array<float, kArea> values;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const Sampler sampler(target, pixel, kRadius);
    if (!sampler.valid) return std::nullopt;
    sampler.sample(kSide, &values);
    const float average = mean(values);
    Eigen::Vector2f b = Eigen::Vector2f::Zero();
    float squares = 0.0F;
    for (int i = 0; i < kArea; ++i) {
      const float difference = values[i] - average - patch.brightness[i];
      b.x() += patch.gx[i] * difference;
      b.y() += patch.gy[i] * difference;
      squares += difference * difference;
    }
    const Eigen::Vector2f step = patch.inverse_hessian * b;
    pixel -= step;
    if ((pixel - initial_px).squaredNorm() > kMaxShiftPx * kMaxShiftPx) return std::nullopt;
    if (step.squaredNorm() < kConvergedPx * kConvergedPx) {
      return squares <= kArea * kMaxResidual * kMaxResidual ? std::make_optional(pixel)
                                                            : std::nullopt;
    }
  }
  return std::nullopt;
}

}  // namespace point_line_odometry
