#include "matching/patch_samples.h"

#include <array>
#include <cstdint>
#include <opencv2/core/hal/intrin.hpp>

namespace point_line_odometry {
namespace {

constexpr int kSide = PatchAligner::kSide;
constexpr int kHalf = kSide / 2;
constexpr int kPitch = PatchAligner::kPitch;
constexpr int kWide = PatchAligner::kWide;
constexpr int kWider = kWide + 2;
constexpr int kWiderPitch = kWider + 1;

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

constexpr float kMeanBlur = 1.0F / 12.0F;  // weight of either neighbour: half the variance

/// Weight of either neighbour for a bilinear sample at a share of the way: negative where it is too
/// blurred itself.
cv::v_float32x4 blurAt(const cv::v_float32x4& share) {
  return cv::v_setall_f32(kMeanBlur) +
         cv::v_setall_f32(0.5F) * share * (share - cv::v_setall_f32(1.0F));
}

/// Weights of four pixels for the sample between the second and the third.
std::array<cv::v_float32x4, 4> weightsAt(float share) {
  const cv::v_float32x4 one = cv::v_setall_f32(1.0F);
  const cv::v_float32x4 right = cv::v_setall_f32(share);
  const cv::v_float32x4 left = one - right;
  const cv::v_float32x4 blur = blurAt(right);
  const cv::v_float32x4 here = one - (blur + blur);
  return {blur * left, here * left + blur * right, here * right + blur * left, blur * right};
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

}  // namespace

bool samplePatch(const cv::Mat& image, const Eigen::Vector2f& centre, Patch* values) {
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

bool sampleSlantedPatch(const cv::Mat& image, const AlignedPatch& seen, Patch* values) {
  // Pixels of a row, in fours: kSide * (1 + kMaxPatchSlope) and two more.
  constexpr int kMaxSpan = 24;
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

std::optional<WidePatch> sampleWidePatch(const cv::Mat& image, const Eigen::Vector2f& pixel) {
  Samples samples;
  if (!sampleOnPixels(image, pixel, &samples) &&
      !sampleWarped(image, pixel, Eigen::Matrix2f::Identity(), &samples)) {
    return std::nullopt;
  }
  return samples.toWidePatch();
}

std::optional<WidePatch> sampleWidePatch(const cv::Mat& image, const Eigen::Vector2f& pixel,
                                         const Eigen::Matrix2f& source_by_target) {
  Samples samples;
  if (!sampleWarped(image, pixel, source_by_target, &samples)) return std::nullopt;
  return samples.toWidePatch();
}

}  // namespace point_line_odometry
