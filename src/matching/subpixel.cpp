#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <opencv2/core/hal/intrin.hpp>

#include "point_line_odometry/matching.h"

namespace point_line_odometry {
namespace {

constexpr int kSide = PatchAligner::kSide;
constexpr int kHalf = kSide / 2;
constexpr int kPitch = PatchAligner::kPitch;
constexpr int kArea = kSide * kSide;
constexpr int kWide = PatchAligner::kWide;
constexpr int kWider = kWide + 2;
constexpr int kWiderPitch = kWider + 1;
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
constexpr float kMaxSlope = 0.7F;
constexpr float kMaxSlantedResidual = 8.0F;  // RMS, as above

using Patch = PatchAligner::Patch;
using WidePatch = PatchAligner::WidePatch;

/// Pixels round a place in an image, and where it lies between them.
struct Place {
  const uchar* origin = nullptr;  // top-left pixel
  std::ptrdiff_t step = 0;
  float right = 0.0F;  // share of the way to the right neighbour
  float below = 0.0F;
  bool valid = false;  // all pixels lie in the image

  /// \param before pixels to the left of the place and above it.
  Place(const cv::Mat& image, const Eigen::Vector2f& centre, int before, int rows, int columns) {
    // In floats: no int holds NaN or a huge place.
    const auto begin = static_cast<float>(before);
    valid = centre.x() >= begin && centre.y() >= begin &&
            centre.x() < static_cast<float>(image.cols - columns + before + 1) &&
            centre.y() < static_cast<float>(image.rows - rows + before + 1);
    if (!valid) return;
    const int x = static_cast<int>(centre.x());
    const int y = static_cast<int>(centre.y());
    right = centre.x() - static_cast<float>(x);
    below = centre.y() - static_cast<float>(y);
    step = static_cast<std::ptrdiff_t>(image.step1());
    origin = image.ptr<uchar>(y - before) + (x - before);
  }
};

cv::v_float32x4 loadFour(const uchar* p) {
  return cv::v_cvt_f32(cv::v_reinterpret_as_s32(cv::v_load_expand_q(p)));
}

// A bilinear sample is a mean of pixels: at a share f of the way from one to the next it is blurred
// with a variance of f (1 - f) px^2. Patches that are compared lie anywhere between the pixels, and
// one that is sharper than another looks as if it were narrower, and its corners elsewhere. So all
// are blurred as much as samples are on the average of all places: with 1/6 px^2 along either axis.

constexpr float kMeanBlur = 1.0F / 12.0F;  // weight of either neighbour: half the variance

/// Weight of either neighbour for a bilinear sample at a share of the way: negative where it is too
/// blurred itself.
cv::v_float32x4 blurAt(const cv::v_float32x4& share) {
  return cv::v_setall_f32(kMeanBlur) +
         cv::v_setall_f32(0.5F) * share * (share - cv::v_setall_f32(1.0F));
}

/// Weights of four pixels for the sample between the second and the third.
std::array<cv::v_float32x4, 4> weightsAt(float share) {
  const float blur = kMeanBlur - 0.5F * share * (1.0F - share);
  const float here = 1.0F - 2.0F * blur;
  return {cv::v_setall_f32(blur * (1.0F - share)),
          cv::v_setall_f32(here * (1.0F - share) + blur * share),
          cv::v_setall_f32(here * share + blur * (1.0F - share)), cv::v_setall_f32(blur * share)};
}

/// Samples of a patch between the pixels: along the rows first, then between them. False if a pixel
/// that is read lies outside of the image.
bool sample(const cv::Mat& image, const Eigen::Vector2f& centre, Patch* values) {
  constexpr int kRows = kSide + 3;
  const Place place(image, centre, kHalf + 1, kRows, kPitch + 3);
  if (!place.valid) return false;
  const auto along = weightsAt(place.right);
  const auto across = weightsAt(place.below);
  std::array<float, kRows * kPitch> rows;
  for (int r = 0; r < kRows; ++r) {
    for (int c = 0; c < kPitch; c += 4) {
      const uchar* p = place.origin + r * place.step + c;
      v_store(rows.data() + r * kPitch + c, along[0] * loadFour(p) + along[1] * loadFour(p + 1) +
                                                along[2] * loadFour(p + 2) +
                                                along[3] * loadFour(p + 3));
    }
  }
  for (int i = 0; i < kSide * kPitch; i += 4) {
    const float* p = rows.data() + i;
    v_store(values->data() + i, across[0] * cv::v_load(p) + across[1] * cv::v_load(p + kPitch) +
                                    across[2] * cv::v_load(p + 2 * kPitch) +
                                    across[3] * cv::v_load(p + 3 * kPitch));
  }
  return true;
}

/// A pixel in the lower byte, its right neighbour in the upper one.
std::uint32_t loadPair(const uchar* p) {
  return static_cast<std::uint32_t>(p[0]) | static_cast<std::uint32_t>(p[1]) << 8;
}

/// Bilinear samples of four places in an image, whose pixels to the upper left are given, too.
cv::v_float32x4 sampleFour(const uchar* image, std::ptrdiff_t step, const cv::v_int32x4& left,
                           const cv::v_int32x4& above, const cv::v_float32x4& right,
                           const cv::v_float32x4& below) {
  std::array<int, 4> columns;
  std::array<int, 4> rows;
  v_store(columns.data(), left);
  v_store(rows.data(), above);
  const auto neighbours = [&](int i) {
    const uchar* p = image + rows[i] * step + columns[i];
    return loadPair(p) | loadPair(p + step) << 16;
  };
  const cv::v_uint32x4 all(neighbours(0), neighbours(1), neighbours(2), neighbours(3));
  const cv::v_uint32x4 byte = cv::v_setall_u32(255);
  const auto toFloats = [](const cv::v_uint32x4& values) {
    return cv::v_cvt_f32(cv::v_reinterpret_as_s32(values));
  };
  const cv::v_float32x4 above_left = toFloats(all & byte);
  const cv::v_float32x4 above_right = toFloats((all >> 8) & byte);
  const cv::v_float32x4 below_left = toFloats((all >> 16) & byte);
  const cv::v_float32x4 below_right = toFloats(all >> 24);
  const cv::v_float32x4 upper = above_left + right * (above_right - above_left);
  const cv::v_float32x4 lower = below_left + right * (below_right - below_left);
  return upper + below * (lower - upper);
}

/// Bilinear samples of a patch with a border of one pixel, and by how much to blur them.
struct Samples {
  using Values = std::array<float, kWider * kWiderPitch>;
  Values brightness;
  Values blur_x;  // weight of either neighbour in the row; negative where it is too blurred
  Values blur_y;

  WidePatch toWidePatch() const {
    std::array<float, kWider * kWide> rows;  // blurred along them
    for (int r = 0; r < kWider; ++r) {
      const float* here = brightness.data() + r * kWiderPitch + 1;
      const float* weight = blur_x.data() + r * kWiderPitch + 1;
      for (int c = 0; c < kWide; ++c) {
        rows[r * kWide + c] =
            here[c] + weight[c] * ((here[c - 1] - here[c]) + (here[c + 1] - here[c]));
      }
    }
    WidePatch wide;
    for (int r = 0; r < kWide; ++r) {
      const float* here = rows.data() + (r + 1) * kWide;
      const float* weight = blur_y.data() + (r + 1) * kWiderPitch + 1;
      for (int c = 0; c < kWide; ++c) {
        wide[r * kWide + c] =
            here[c] + weight[c] * ((here[c - kWide] - here[c]) + (here[c + kWide] - here[c]));
      }
    }
    return wide;
  }
};

/// Samples of a patch round a pixel, which corners are. False if it is none, or too near to the
/// image's border.
bool sampleOnPixels(const cv::Mat& image, const Eigen::Vector2f& pixel, Samples* samples) {
  const Place place(image, pixel, kWider / 2, kWider, kWiderPitch);
  if (!place.valid || place.right != 0.0F || place.below != 0.0F) return false;
  for (int r = 0; r < kWider; ++r) {
    for (int c = 0; c < kWiderPitch; c += 4) {
      v_store(samples->brightness.data() + r * kWiderPitch + c,
              loadFour(place.origin + r * place.step + c));
    }
  }
  samples->blur_x.fill(kMeanBlur);
  samples->blur_y.fill(kMeanBlur);
  return true;
}

/// Samples of a patch whose pixels are `source_by_target` apart. False if a corner lies outside of
/// the image.
bool sampleWarped(const cv::Mat& image, const Eigen::Vector2f& centre,
                  const Eigen::Matrix2f& source_by_target, Samples* samples) {
  constexpr float kHalfWider = 0.5F * (kWider - 1);
  constexpr float kRounding = 0.001F;  // more than floats of this size are wrong by [px]
  const Eigen::Vector2f extent =
      (kHalfWider * source_by_target.cwiseAbs().rowwise().sum()).array() + kRounding;
  const Eigen::Vector2f low = centre - extent;
  const Eigen::Vector2f high = centre + extent;
  if (!(low.x() >= 0.0F && low.y() >= 0.0F && high.x() < static_cast<float>(image.cols - 1) &&
        high.y() < static_cast<float>(image.rows - 1))) {
    return false;
  }
  const auto step = static_cast<std::ptrdiff_t>(image.step1());
  const cv::v_float32x4 x_by_column = cv::v_setall_f32(source_by_target(0, 0));
  const cv::v_float32x4 y_by_column = cv::v_setall_f32(source_by_target(1, 0));
  for (int r = 0; r < kWider; ++r) {
    const Eigen::Vector2f middle =
        centre + (static_cast<float>(r) - kHalfWider) * source_by_target.col(1);
    cv::v_float32x4 column(-kHalfWider, 1.0F - kHalfWider, 2.0F - kHalfWider, 3.0F - kHalfWider);
    for (int c = 0; c < kWiderPitch; c += 4, column = column + cv::v_setall_f32(4.0F)) {
      const cv::v_float32x4 inside = cv::v_min(column, cv::v_setall_f32(kHalfWider));
      const cv::v_float32x4 x = cv::v_setall_f32(middle.x()) + x_by_column * inside;
      const cv::v_float32x4 y = cv::v_setall_f32(middle.y()) + y_by_column * inside;
      const cv::v_int32x4 left = cv::v_trunc(x);
      const cv::v_int32x4 above = cv::v_trunc(y);
      const cv::v_float32x4 right = x - cv::v_cvt_f32(left);
      const cv::v_float32x4 below = y - cv::v_cvt_f32(above);
      const int i = r * kWiderPitch + c;
      v_store(samples->brightness.data() + i,
              sampleFour(image.data, step, left, above, right, below));
      v_store(samples->blur_x.data() + i, blurAt(right));
      v_store(samples->blur_y.data() + i, blurAt(below));
    }
  }
  return true;
}

/// Bilinear samples where a slanted patch is seen: between the rows first, then along them. False
/// if a pixel that is read lies outside of the image.
bool sampleSlanted(const cv::Mat& image, const AlignedPatch& seen, Patch* values) {
  constexpr int kMaxSpan = 24;  // pixels of a row, in fours: kSide * (1 + kMaxSlope) and two more
  const float extent = kHalf * (1.0F + seen.slope.lpNorm<1>());
  const Eigen::Vector2f& centre = seen.pixel;
  if (!(centre.x() >= extent && centre.y() >= kHalf &&
        centre.x() + extent + 4.0F < static_cast<float>(image.cols) &&
        centre.y() + kHalf < static_cast<float>(image.rows - 1))) {
    return false;
  }
  const int y = static_cast<int>(centre.y());
  const auto step = static_cast<std::ptrdiff_t>(image.step1());
  const cv::v_float32x4 below = cv::v_setall_f32(centre.y() - static_cast<float>(y));
  const float along = 1.0F + seen.slope.x();
  // All rows before any is read again: what has just been written is slow to read elsewhere.
  std::array<std::array<float, kMaxSpan>, kSide> rows{};
  std::array<float, kSide> offsets;
  for (int r = 0; r < kSide; ++r) {
    const float begin = centre.x() + seen.slope.y() * static_cast<float>(r - kHalf) - kHalf * along;
    const int first = static_cast<int>(begin);
    offsets[r] = begin - static_cast<float>(first);
    const uchar* p = image.ptr<uchar>(y - kHalf + r) + first;
    const int last = static_cast<int>(offsets[r] + (kSide - 1) * along) + 1;
    for (int c = 0; c <= last; c += 4) {
      const cv::v_float32x4 above = loadFour(p + c);
      v_store(rows[r].data() + c, above + below * (loadFour(p + step + c) - above));
    }
  }
  const cv::v_float32x4 by_column = cv::v_setall_f32(along);
  for (int r = 0; r < kSide; ++r) {
    cv::v_float32x4 column(0.0F, 1.0F, 2.0F, 3.0F);
    for (int c = 0; c < kPitch; c += 4, column = column + cv::v_setall_f32(4.0F)) {
      const cv::v_float32x4 at = cv::v_setall_f32(offsets[r]) + by_column * column;
      const cv::v_int32x4 left = cv::v_trunc(at);
      cv::v_float32x4 here;
      cv::v_float32x4 right;
      cv::v_lut_deinterleave(rows[r].data(), left, here, right);
      v_store(values->data() + r * kPitch + c, here + (at - cv::v_cvt_f32(left)) * (right - here));
    }
    (*values)[r * kPitch + kSide] = 0.0F;
  }
  return true;
}

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
  Samples samples;
  if (!sampleOnPixels(image, pixel, &samples) &&
      !sampleWarped(image, pixel, Eigen::Matrix2f::Identity(), &samples)) {
    return;
  }
  prepare(samples.toWidePatch());
}

PatchAligner::PatchAligner(const cv::Mat& image, const Eigen::Vector2f& pixel,
                           const Eigen::Matrix2f& source_by_target) {
  Samples samples;
  if (sampleWarped(image, pixel, source_by_target, &samples)) prepare(samples.toWidePatch());
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
  hessian << dots<2>({&gx_, &gy_}, gx_), dots<2>({&gx_, &gy_}, gy_);
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
    if (!sample(target, pixel, &values)) return std::nullopt;
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
  for (int i = 0; i < 4; ++i) hessian.col(i) = dots(by, *by[i]);
  hessian(2, 2) += kPrior;
  hessian(3, 3) += kPrior;
  const Eigen::Matrix4f inverse_hessian = hessian.inverse();

  AlignedPatch seen{initial_px};
  Patch values;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (!sampleSlanted(target, seen, &values)) return std::nullopt;
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
          seen.slope.lpNorm<Eigen::Infinity>() <= kMaxSlope)) {
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
