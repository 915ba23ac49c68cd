#include "features/structure_tensor.h"

#include <array>
#include <cstdint>
#include <opencv2/core/hal/intrin.hpp>
#include <stdexcept>
#include <string>

#include "common/non_zero_bytes.h"
#include "common/processor_clones.h"

namespace point_line_odometry {
namespace {

constexpr int kSide = kStructureTensorSide;
constexpr int kHalf = kSide / 2;
constexpr int kLeastBorder = kHalf + 2;  // a neighbour's block, and the Sobel filter
constexpr int kFour = 4;                 // values of a vector

// Rows are as long as the image's, and a vector more, which is written and never used.

struct Gradients {
  std::vector<std::int16_t> x;
  std::vector<std::int16_t> y;
};

/// Sums of the gradients' products over the last kSide rows, for each column.
struct ColumnSums {
  std::vector<std::int32_t> xx;
  std::vector<std::int32_t> xy;
  std::vector<std::int32_t> yy;
};

POINT_LINE_ODOMETRY_CLONES("avx2")
void sobelRow(const std::uint8_t* __restrict above, const std::uint8_t* __restrict here,
              const std::uint8_t* __restrict below, int width, std::int16_t* __restrict gx,
              std::int16_t* __restrict gy) {
  for (int x = 1; x < width - 1; ++x) {
    const int right = above[x + 1] + 2 * here[x + 1] + below[x + 1];
    const int left = above[x - 1] + 2 * here[x - 1] + below[x - 1];
    const int lower = below[x - 1] + 2 * below[x] + below[x + 1];
    const int upper = above[x - 1] + 2 * above[x] + above[x + 1];
    gx[x] = static_cast<std::int16_t>(right - left);
    gy[x] = static_cast<std::int16_t>(lower - upper);
  }
}

/// Adds a row's products, and takes away those of the row that leaves the block.
POINT_LINE_ODOMETRY_CLONES("avx2")
void moveBlock(const Gradients& enters, const Gradients& leaves, int width, ColumnSums* sums) {
  const std::int16_t* __restrict gx = enters.x.data();
  const std::int16_t* __restrict gy = enters.y.data();
  const std::int16_t* __restrict old_gx = leaves.x.data();
  const std::int16_t* __restrict old_gy = leaves.y.data();
  std::int32_t* __restrict xx = sums->xx.data();
  std::int32_t* __restrict xy = sums->xy.data();
  std::int32_t* __restrict yy = sums->yy.data();
  for (int x = 0; x < width; ++x) {
    xx[x] += gx[x] * gx[x] - old_gx[x] * old_gx[x];
    xy[x] += gx[x] * gy[x] - old_gx[x] * old_gy[x];
    yy[x] += gy[x] * gy[x] - old_gy[x] * old_gy[x];
  }
}

/// Sums of kSide columns, as threes of threes. \param threes memory for sums of three.
POINT_LINE_ODOMETRY_CLONES("avx2")
void sumColumns(const std::int32_t* __restrict columns, int begin, int end,
                std::int32_t* __restrict threes, float* __restrict sums) {
  static_assert(kSide == 9);
  for (int x = begin - 3; x < end + 3; ++x)
    threes[x] = columns[x - 1] + columns[x] + columns[x + 1];
  for (int x = begin; x < end; ++x)
    sums[x] = static_cast<float>(threes[x - 3] + threes[x] + threes[x + 3]);
}

/// The smaller eigenvalue of [xx xy; xy yy]: (xx + yy) / 2 - sqrt(((xx - yy) / 2)^2 + xy^2).
POINT_LINE_ODOMETRY_CLONES("avx2")
void eigenvalueRow(const float* xx, const float* xy, const float* yy, int begin, int end,
                   float* eigenvalues) {
  const cv::v_float32x4 half = cv::v_setall_f32(0.5F);
  for (int x = begin; x < end; x += kFour) {
    const cv::v_float32x4 a = half * cv::v_load(xx + x);
    const cv::v_float32x4 b = cv::v_load(xy + x);
    const cv::v_float32x4 c = half * cv::v_load(yy + x);
    v_store(eigenvalues + x, (a + c) - v_sqrt((a - c) * (a - c) + b * b));
  }
}

using ThreeRows = std::array<const float*, 3>;

/// Marks the pixels of the middle row that none of their eight neighbours exceeds.
POINT_LINE_ODOMETRY_CLONES("avx2")
void markMaxima(const ThreeRows& rows, int begin, int end, std::uint8_t* __restrict marks) {
  const float* above = rows[0];
  const float* here = rows[1];
  const float* below = rows[2];
  const auto largest = [](float a, float b) { return a > b ? a : b; };
  for (int x = begin; x < end; ++x) {
    const float left = largest(largest(above[x - 1], here[x - 1]), below[x - 1]);
    const float right = largest(largest(above[x + 1], here[x + 1]), below[x + 1]);
    const float neighbour = largest(largest(left, right), largest(above[x], below[x]));
    marks[x] = static_cast<std::uint8_t>((here[x] >= neighbour) & (here[x] > 0.0F));
  }
}

/// Moves a block of kSide rows down an image and keeps the eigenvalues of the last three rows.
class EigenvalueRows {
 public:
  EigenvalueRows(const cv::Mat& image, int border) : image_(image), border_(border) {
    const std::size_t size = static_cast<std::size_t>(image.cols) + kFour;
    for (Gradients& row : gradients_) {
      row.x.resize(size);
      row.y.resize(size);
    }
    for (std::vector<std::int32_t>* sums : {&sums_.xx, &sums_.xy, &sums_.yy}) sums->resize(size);
    threes_.resize(size);
    for (std::vector<float>* row : {&xx_, &xy_, &yy_}) row->resize(size);
    for (std::vector<float>& row : eigenvalues_) row.resize(size);
  }

  /// Adds row y of the image to the block: all but the first and the last one, in turn.
  void add(int y) {
    Gradients& enters = gradients_[index(y, kSide + 1)];
    const Gradients& leaves = gradients_[index(y + 1, kSide + 1)];  // row y - kSide; zeros at first
    sobelRow(image_.ptr<std::uint8_t>(y - 1), image_.ptr<std::uint8_t>(y),
             image_.ptr<std::uint8_t>(y + 1), image_.cols, enters.x.data(), enters.y.data());
    moveBlock(enters, leaves, image_.cols, &sums_);
  }

  /// Computes the eigenvalues in the middle row of the block, which is full.
  void computeRow(int y) {
    const int begin = border_ - 1;
    const int end = image_.cols - border_ + 1;
    sumColumns(sums_.xx.data(), begin, end, threes_.data(), xx_.data());
    sumColumns(sums_.xy.data(), begin, end, threes_.data(), xy_.data());
    sumColumns(sums_.yy.data(), begin, end, threes_.data(), yy_.data());
    eigenvalueRow(xx_.data(), xy_.data(), yy_.data(), begin, end, eigenvalues_[index(y, 3)].data());
  }

  ThreeRows around(int y) const {
    return {eigenvalues_[index(y - 1, 3)].data(), eigenvalues_[index(y, 3)].data(),
            eigenvalues_[index(y + 1, 3)].data()};
  }

 private:
  static std::size_t index(int y, int num_rows) { return static_cast<std::size_t>(y % num_rows); }

  const cv::Mat& image_;
  int border_;
  std::array<Gradients, kSide + 1> gradients_;
  ColumnSums sums_;
  std::vector<std::int32_t> threes_;  // scratch memory
  std::vector<float> xx_;             // sums over the block, for each pixel of a row
  std::vector<float> xy_;
  std::vector<float> yy_;
  std::array<std::vector<float>, 3> eigenvalues_;
};

}  // namespace

std::vector<EigenvalueMaximum> minEigenvalueMaxima(const cv::Mat& image, int border) {
  if (border < kLeastBorder) {
    throw std::invalid_argument("border is " + std::to_string(border) + " px, but must be " +
                                std::to_string(kLeastBorder) + " or more");
  }
  std::vector<EigenvalueMaximum> maxima;
  if (image.cols <= 2 * border || image.rows <= 2 * border) return maxima;
  EigenvalueRows rows(image, border);
  std::vector<std::uint8_t> marks(static_cast<std::size_t>(image.cols) + 8);
  const int end = image.cols - border;
  for (int y = border - kHalf - 1; y <= image.rows - border + kHalf; ++y) {
    rows.add(y);
    const int computed = y - kHalf;
    if (computed < border - 1) continue;
    rows.computeRow(computed);
    const int tested = computed - 1;
    if (tested < border) continue;
    const ThreeRows around = rows.around(tested);
    markMaxima(around, border, end, marks.data());
    forEachNonZero(marks.data(), border, end, [&](int x) {
      maxima.push_back({x, tested, around[1][x]});
    });
  }
  return maxima;
}

}  // namespace point_line_odometry
