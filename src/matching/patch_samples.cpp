#include "matching/patch_samples.h"

#include <array>
#include <cstdint>
#include <cstring>
#include <opencv2/core/hal/intrin.hpp>

#include "common/processor_clones.h"

namespace point_line_odometry {
namespace {

constexpr int kPatchSide = PatchAligner::kSide;
constexpr int kHalfPatch = kPatchSide / 2;
constexpr int kPatchPitch = PatchAligner::kPitch;
constexpr int kWide = PatchAligner::kWide;
constexpr int kWider = kWide + 2;
constexpr int kWiderPitch = kWider + 1;
constexpr float kHalfWider = 0.5F * (kWider - 1);
// Offsets of the columns from the middle. The last one, of no use, is sampled at its neighbour's.
constexpr float kFromMiddle[kWiderPitch] = {-7, -6, -5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5, 6, 7, 7};

using Patch = PatchAligner::Patch;
using WidePatch = PatchAligner::WidePatch;

/// The pixels around a sub-pixel position in an image, and its fractional part.
struct PixelWindow {
  const uchar* origin = nullptr;  // top-left pixel
  std::ptrdiff_t step = 0;
  float right = 0.0F;  // fraction of the distance to the right neighbour
  float below = 0.0F;
  bool valid = false;  // all pixels lie in the image

  /// \param before pixels to the left of the centre and above it.
  PixelWindow(const cv::Mat& image, const Eigen::Vector2f& centre, int before, int rows,
              int columns) {
    // In floats: no int represents NaN or a huge coordinate.
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

constexpr float kMeanBlur = 1.0F / 12.0F;  // weight of either neighbour: half the variance

/// Weight of either neighbour that blurs a bilinear sample at a fraction of a pixel as all others;
/// negative where the sample is blurred more.
inline float blurAt(float fraction) { return kMeanBlur + 0.5F * fraction * (fraction - 1.0F); }

inline cv::v_float32x4 loadFour(const uchar* p) {
  return cv::v_cvt_f32(cv::v_reinterpret_as_s32(cv::v_load_expand_q(p)));
}

using Weights = std::array<cv::v_float32x4, 4>;

/// Weights of four pixels for the sample between the second and the third.
Weights weightsAt(float fraction) {
  const float left = 1.0F - fraction;
  const float blur = blurAt(fraction);
  const float here = 1.0F - (blur + blur);
  return {cv::v_setall_f32(blur * left), cv::v_setall_f32(here * left + blur * fraction),
          cv::v_setall_f32(here * fraction + blur * left), cv::v_setall_f32(blur * fraction)};
}

/// Samples of a patch at a fraction of a pixel, from its pixels and those around it. All rows are
/// written before any is read: reading just-written memory at other offsets stalls (store
/// forwarding).
POINT_LINE_ODOMETRY_CLONES("avx2")
void interpolate(const uchar* origin, std::ptrdiff_t step, const Weights& along,
                 const Weights& across, float* __restrict values) {
  float pixels[kPatchSide + 3][kPatchPitch + 4];
  for (int r = 0; r < kPatchSide + 3; ++r) {
    const uchar* p = origin + r * step;
    for (const int c : {0, 4, 8, kPatchPitch - 1}) v_store(pixels[r] + c, loadFour(p + c));
  }
  float rows[kPatchSide + 3][kPatchPitch];
  for (int r = 0; r < kPatchSide + 3; ++r) {
    for (int c = 0; c < kPatchPitch; c += 4) {
      const float* p = pixels[r] + c;
      v_store(rows[r] + c, along[0] * cv::v_load(p) + along[1] * cv::v_load(p + 1) +
                               along[2] * cv::v_load(p + 2) + along[3] * cv::v_load(p + 3));
    }
  }
  for (int r = 0; r < kPatchSide; ++r) {
    for (int c = 0; c < kPatchPitch; c += 4) {
      v_store(values + r * kPatchPitch + c, across[0] * cv::v_load(rows[r] + c) +
                                                across[1] * cv::v_load(rows[r + 1] + c) +
                                                across[2] * cv::v_load(rows[r + 2] + c) +
                                                across[3] * cv::v_load(rows[r + 3] + c));
    }
  }
}

/// Bilinear samples of a patch with a border of one pixel, and the weights that blur them equally.
struct Samples {
  // Two more, so that a row's neighbours can be read beyond the last one.
  using Values = std::array<float, kWider * kWiderPitch + 2>;
  Values brightness;
  Values blur_x;  // weight of either neighbour in the row; negative where it is blurred more
  Values blur_y;

  Samples() {  // all others are written before they are read
    for (Values* values : {&brightness, &blur_x, &blur_y})
      values->end()[-1] = values->end()[-2] = 0.0F;
  }
};

/// Blurs the samples along their rows, then along the columns. Whole rows of the memory are
/// computed, as vectors: the last three columns are of no use.
POINT_LINE_ODOMETRY_CLONES("avx2")
void blur(const Samples& samples, float* __restrict wide) {
  static_assert(PatchAligner::kWidePitch == kWiderPitch);
  float rows[kWider * kWiderPitch];
  for (int i = 0; i < kWider * kWiderPitch; ++i) {
    const float* p = samples.brightness.data() + i + 1;
    rows[i] = p[0] + samples.blur_x[i + 1] * ((p[-1] - p[0]) + (p[1] - p[0]));
  }
  for (int i = 0; i < kWide * kWiderPitch; ++i) {
    const float* p = rows + i + kWiderPitch;
    wide[i] = p[0] + samples.blur_y[i + kWiderPitch + 1] *
                         ((p[-kWiderPitch] - p[0]) + (p[kWiderPitch] - p[0]));
  }
}

/// Samples of a patch around an integer pixel, as detected corners are. False at other positions or
/// too near to the image's border.
bool sampleOnPixels(const cv::Mat& image, const Eigen::Vector2f& pixel, Samples* samples) {
  const PixelWindow window(image, pixel, kWider / 2, kWider, kWiderPitch);
  if (!window.valid || window.right != 0.0F || window.below != 0.0F) return false;
  for (int r = 0; r < kWider; ++r) {
    const uchar* p = window.origin + r * window.step;
    for (int c = 0; c < kWiderPitch; c += 4)
      v_store(samples->brightness.data() + r * kWiderPitch + c, loadFour(p + c));
  }
  samples->blur_x.fill(kMeanBlur);
  samples->blur_y.fill(kMeanBlur);
  return true;
}

/// Two by two pixels in one word: those of the upper row in the lower bytes.
inline std::uint32_t loadSquare(const uchar* p, std::ptrdiff_t step) {
  std::uint16_t upper;
  std::uint16_t lower;
  std::memcpy(&upper, p, sizeof(upper));
  std::memcpy(&lower, p + step, sizeof(lower));
  return static_cast<std::uint32_t>(upper) | static_cast<std::uint32_t>(lower) << 16;
}

/// Samples of a patch whose corners lie in the image. In two passes, so that each is computed with
/// vectors but for the loading of pixels.
POINT_LINE_ODOMETRY_CLONES("avx2")
void sampleInside(const uchar* image, std::ptrdiff_t step, const float* centre, const float* warp,
                  Samples* __restrict samples) {
  std::uint32_t pixels[kWider * kWiderPitch];
  float right[kWider * kWiderPitch];
  float below[kWider * kWiderPitch];
  const int rows_above = static_cast<int>(centre[1]);
  const uchar* origin = image + rows_above * step;
  const int int_step = static_cast<int>(step);
  for (int r = 0; r < kWider; ++r) {
    const float down = static_cast<float>(r) - kHalfWider;
    const float middle_x = centre[0] + down * warp[2];
    const float middle_y = centre[1] + down * warp[3];
    int offsets[kWiderPitch];
    for (int c = 0; c < kWiderPitch; ++c) {
      const float x = middle_x + warp[0] * kFromMiddle[c];
      const float y = middle_y + warp[1] * kFromMiddle[c];
      const int left = static_cast<int>(x);
      const int above = static_cast<int>(y);
      right[r * kWiderPitch + c] = x - static_cast<float>(left);
      below[r * kWiderPitch + c] = y - static_cast<float>(above);
      offsets[c] = (above - rows_above) * int_step + left;
    }
    for (int c = 0; c < kWiderPitch; ++c)
      pixels[r * kWiderPitch + c] = loadSquare(origin + offsets[c], step);
  }
  for (int i = 0; i < kWider * kWiderPitch; ++i) {
    const auto byte = [&](int k) { return static_cast<float>((pixels[i] >> (8 * k)) & 255U); };
    const float upper = byte(0) + right[i] * (byte(1) - byte(0));
    const float lower = byte(2) + right[i] * (byte(3) - byte(2));
    samples->brightness[i] = upper + below[i] * (lower - upper);
    samples->blur_x[i] = blurAt(right[i]);
    samples->blur_y[i] = blurAt(below[i]);
  }
}

/// Samples of a patch under an affine warp. False if a corner lies outside of the image.
bool sampleWarped(const cv::Mat& image, const Eigen::Vector2f& centre, const Eigen::Matrix2f& warp,
                  Samples* samples) {
  constexpr float kRounding = 0.001F;  // more than floats of this size are wrong by [px]
  const Eigen::Vector2f extent = (kHalfWider * warp.cwiseAbs().rowwise().sum()).array() + kRounding;
  const Eigen::Vector2f low = centre - extent;
  const Eigen::Vector2f high = centre + extent;
  if (!(low.x() >= 0.0F && low.y() >= 0.0F && high.x() < static_cast<float>(image.cols - 1) &&
        high.y() < static_cast<float>(image.rows - 1))) {
    return false;
  }
  sampleInside(image.data, static_cast<std::ptrdiff_t>(image.step1()), centre.data(), warp.data(),
               samples);
  return true;
}

/// Bilinear samples of a patch at an aligned position and slope that lies in the image. All rows
/// are written before any is read, as in interpolate().
void interpolateSlanted(const cv::Mat& image, const AlignedPatch& seen, float* values) {
  // Pixels of a row, in fours: kPatchSide * (1 + kMaxPatchSlope) and two more.
  constexpr int kMaxSpan = 24;
  const int y = static_cast<int>(seen.pixel.y());
  const auto step = static_cast<std::ptrdiff_t>(image.step1());
  const cv::v_float32x4 below = cv::v_setall_f32(seen.pixel.y() - static_cast<float>(y));
  const float along = 1.0F + seen.slope.x();
  std::array<std::array<float, kMaxSpan>, kPatchSide> rows{};
  std::array<float, kPatchSide> offsets;
  for (int r = 0; r < kPatchSide; ++r) {
    const float begin =
        seen.pixel.x() + seen.slope.y() * static_cast<float>(r - kHalfPatch) - kHalfPatch * along;
    const int first = static_cast<int>(begin);
    offsets[r] = begin - static_cast<float>(first);
    const uchar* p = image.ptr<uchar>(y - kHalfPatch + r) + first;
    const int last = static_cast<int>(offsets[r] + (kPatchSide - 1) * along) + 1;
    for (int c = 0; c <= last; c += 4) {
      const cv::v_float32x4 above = loadFour(p + c);
      v_store(rows[r].data() + c, above + below * (loadFour(p + step + c) - above));
    }
  }
  const cv::v_float32x4 by_column = cv::v_setall_f32(along);
  for (int r = 0; r < kPatchSide; ++r) {
    cv::v_float32x4 column(0.0F, 1.0F, 2.0F, 3.0F);
    for (int c = 0; c < kPatchPitch; c += 4, column = column + cv::v_setall_f32(4.0F)) {
      const cv::v_float32x4 at = cv::v_setall_f32(offsets[r]) + by_column * column;
      const cv::v_int32x4 left = cv::v_trunc(at);
      cv::v_float32x4 here;
      cv::v_float32x4 right;
      cv::v_lut_deinterleave(rows[r].data(), left, here, right);
      v_store(values + r * kPatchPitch + c, here + (at - cv::v_cvt_f32(left)) * (right - here));
    }
    values[r * kPatchPitch + kPatchSide] = 0.0F;
  }
}

}  // namespace

bool samplePatch(const cv::Mat& image, const Eigen::Vector2f& centre, Patch* values) {
  constexpr int kRows = kPatchSide + 3;
  const PixelWindow window(image, centre, kHalfPatch + 1, kRows, kPatchPitch + 3);
  if (!window.valid) return false;
  interpolate(window.origin, window.step, weightsAt(window.right), weightsAt(window.below),
              values->data());
  return true;
}

bool sampleSlantedPatch(const cv::Mat& image, const AlignedPatch& seen, Patch* values) {
  const float extent = kHalfPatch * (1.0F + seen.slope.lpNorm<1>());
  const Eigen::Vector2f& centre = seen.pixel;
  if (!(centre.x() >= extent && centre.y() >= kHalfPatch &&
        centre.x() + extent + 4.0F < static_cast<float>(image.cols) &&
        centre.y() + kHalfPatch < static_cast<float>(image.rows - 1))) {
    return false;
  }
  interpolateSlanted(image, seen, values->data());
  return true;
}

std::optional<WidePatch> sampleWidePatch(const cv::Mat& image, const Eigen::Vector2f& pixel) {
  Samples samples;
  if (!sampleOnPixels(image, pixel, &samples) &&
      !sampleWarped(image, pixel, Eigen::Matrix2f::Identity(), &samples)) {
    return std::nullopt;
  }
  std::optional<WidePatch> wide(std::in_place);
  blur(samples, wide->data());
  return wide;
}

std::optional<WidePatch> sampleWidePatch(const cv::Mat& image, const Eigen::Vector2f& pixel,
                                         const Eigen::Matrix2f& warp) {
  Samples samples;
  if (!sampleWarped(image, pixel, warp, &samples)) return std::nullopt;
  std::optional<WidePatch> wide(std::in_place);
  blur(samples, wide->data());
  return wide;
}

}  // namespace point_line_odometry
