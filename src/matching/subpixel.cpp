#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core/hal/intrin.hpp>

#include "point_line_odometry/matching.h"

namespace point_line_odometry {
namespace {

constexpr int kSide = PatchAligner::kSide;
constexpr int kPitch = PatchAligner::kPitch;
constexpr int kArea = kSide * kSide;
constexpr int kWide = PatchAligner::kWide;
constexpr int kMaxIterations = 8;
constexpr float kConvergedPx = 0.01F;
constexpr float kMaxShiftPx = 2.5F;    // from the initial place
constexpr float kMaxResidual = 20.0F;  // RMS of the brightness difference [grey levels]

using Patch = PatchAligner::Patch;
using WidePatch = PatchAligner::WidePatch;

/// Where a patch lies between the pixels; valid if all pixels that sample() reads lie in the image.
template <int kRows, int kColumns>
struct Place {
  const uchar* origin = nullptr;  // top-left pixel
  std::ptrdiff_t step = 0;
  float right = 0.0F;  // weight of the right neighbour
  float below = 0.0F;
  bool valid = false;

  Place(const cv::Mat& image, const Eigen::Vector2f& centre) {
    constexpr int kBefore = kRows / 2;
    // In floats: no int holds NaN or a huge place.
    valid = centre.x() >= kBefore && centre.y() >= kBefore &&
            centre.x() - kBefore + kColumns < static_cast<float>(image.cols) &&
            centre.y() - kBefore + kRows < static_cast<float>(image.rows);
    if (!valid) return;
    const int x = static_cast<int>(centre.x());
    const int y = static_cast<int>(centre.y());
    right = centre.x() - static_cast<float>(x);
    below = centre.y() - static_cast<float>(y);
    step = static_cast<std::ptrdiff_t>(image.step1());
    origin = image.ptr<uchar>(y - kBefore) + (x - kBefore);
  }
};

cv::v_float32x4 loadFour(const uchar* p) {
  return cv::v_cvt_f32(cv::v_reinterpret_as_s32(cv::v_load_expand_q(p)));
}

/// Pixels of one row.
template <int kColumns>
std::array<float, kColumns> loadRow(const uchar* p) {
  constexpr int kInFours = kColumns / 4 * 4;
  std::array<float, kColumns> row;
  for (int c = 0; c < kInFours; c += 4) v_store(row.data() + c, loadFour(p + c));
  for (int c = kInFours; c < kColumns; ++c) row[c] = p[c];
  return row;
}

/// Samples between the pixels of one row.
template <int kColumns>
std::array<float, kColumns> sampleRow(const uchar* p, float right) {
  const cv::v_float32x4 weight_right = cv::v_setall_f32(right);
  const cv::v_float32x4 weight_here = cv::v_setall_f32(1.0F - right);
  constexpr int kInFours = kColumns / 4 * 4;
  std::array<float, kColumns> row;
  for (int c = 0; c < kInFours; c += 4) {
    v_store(row.data() + c, loadFour(p + c) * weight_here + loadFour(p + c + 1) * weight_right);
  }
  for (int c = kInFours; c < kColumns; ++c) row[c] = (1.0F - right) * p[c] + right * p[c + 1];
  return row;
}

/// Bilinear samples, kRows rows of kColumns: along the rows first, then between them.
template <int kRows, int kColumns>
void sample(const Place<kRows, kColumns>& place, float* values) {
  if (place.right == 0.0F && place.below == 0.0F) {  // corners lie on pixels
    for (int r = 0; r < kRows; ++r, values += kColumns) {
      const std::array<float, kColumns> row = loadRow<kColumns>(place.origin + r * place.step);
      std::copy(row.begin(), row.end(), values);
    }
    return;
  }
  std::array<float, kColumns> above = sampleRow<kColumns>(place.origin, place.right);
  for (int r = 0; r < kRows; ++r, values += kColumns) {
    const std::array<float, kColumns> below =
        sampleRow<kColumns>(place.origin + (r + 1) * place.step, place.right);
    for (int c = 0; c < kColumns; ++c) values[c] = above[c] + place.below * (below[c] - above[c]);
    above = below;
  }
}

/// Bilinear samples of a wide patch whose pixels are `source_by_target` apart. False if a corner
/// lies outside of the image.
bool sampleWarped(const cv::Mat& image, const Eigen::Vector2f& centre,
                  const Eigen::Matrix2f& source_by_target, float* values) {
  constexpr float kHalf = 0.5F * (kWide - 1);
  const Eigen::Vector2f extent = kHalf * source_by_target.cwiseAbs().rowwise().sum();
  const Eigen::Vector2f low = centre - extent;
  const Eigen::Vector2f high = centre + extent;
  if (!(low.x() >= 0.0F && low.y() >= 0.0F && high.x() < static_cast<float>(image.cols - 1) &&
        high.y() < static_cast<float>(image.rows - 1))) {
    return false;
  }
  const auto step = static_cast<std::ptrdiff_t>(image.step1());
  const Eigen::Vector2f along_row = source_by_target.col(0);
  for (int r = 0; r < kWide; ++r) {
    Eigen::Vector2f at = centre + source_by_target * Eigen::Vector2f(-kHalf, r - kHalf);
    for (int c = 0; c < kWide; ++c, at += along_row) {
      const int x = static_cast<int>(at.x());
      const int y = static_cast<int>(at.y());
      const float right = at.x() - static_cast<float>(x);
      const float below = at.y() - static_cast<float>(y);
      const uchar* p = image.data + y * step + x;
      const float above = static_cast<float>(p[0]) + right * static_cast<float>(p[1] - p[0]);
      const float under =
          static_cast<float>(p[step]) + right * static_cast<float>(p[step + 1] - p[step]);
      *values++ = above + below * (under - above);
    }
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
  float sum = 0.0F;
  for (const float column : sums) sum += column;
  return sum;
}

/// Makes the mean of the patch zero, and its last column.
void centre(Patch* values) {
  float sum = 0.0F;
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kSide; ++c) sum += (*values)[r * kPitch + c];
  }
  const float mean = sum / kArea;
  for (float& value : *values) value -= mean;
  for (int r = 0; r < kSide; ++r) (*values)[r * kPitch + kSide] = 0.0F;
}

}  // namespace

PatchAligner::PatchAligner(const cv::Mat& image, const Eigen::Vector2f& pixel) {
  const Place<kWide, kWide> place(image, pixel);
  if (!place.valid) return;
  WidePatch wide{};
  sample(place, wide.data());
  prepare(wide);
}

PatchAligner::PatchAligner(const cv::Mat& image, const Eigen::Vector2f& pixel,
                           const Eigen::Matrix2f& source_by_target) {
  WidePatch wide{};
  if (!sampleWarped(image, pixel, source_by_target, wide.data())) return;
  prepare(wide);
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
  for (Patch* values : {&brightness_, &gx_, &gy_}) centre(values);
  at_brightness_ = {dot(gx_, brightness_), dot(gy_, brightness_)};
  const float xy = dot(gx_, gy_);
  Eigen::Matrix2f hessian;
  hessian << dot(gx_, gx_), xy, xy, dot(gy_, gy_);
  const float trace = hessian.trace();
  usable_ = hessian.determinant() > 1e-3F * trace * trace && trace > kArea;
  if (usable_) inverse_hessian_ = hessian.inverse();
}

std::optional<Eigen::Vector2f> PatchAligner::align(const cv::Mat& target,
                                                   const Eigen::Vector2f& initial_px) const {
  if (!usable_) return std::nullopt;
  Eigen::Vector2f pixel = initial_px;
  Patch values;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const Place<kSide, kPitch> place(target, pixel);
    if (!place.valid) return std::nullopt;
    sample(place, values.data());
    // The gradients have no mean: that of the brightness drops out of the products.
    const Eigen::Vector2f b = Eigen::Vector2f(dot(gx_, values), dot(gy_, values)) - at_brightness_;
    const Eigen::Vector2f step = inverse_hessian_ * b;
    pixel -= step;
    if ((pixel - initial_px).squaredNorm() > kMaxShiftPx * kMaxShiftPx) return std::nullopt;
    if (step.squaredNorm() >= kConvergedPx * kConvergedPx) continue;
    centre(&values);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] -= brightness_[i];
    if (dot(values, values) > kArea * kMaxResidual * kMaxResidual) return std::nullopt;
    return pixel;
  }
  return std::nullopt;
}

}  // namespace point_line_odometry
