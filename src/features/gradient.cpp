#include "features/gradient.h"

#include <algorithm>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "common/processor_clones.h"

namespace point_line_odometry {
namespace {

POINT_LINE_ODOMETRY_CLONES("avx2")
void sumMagnitudes(const short* __restrict gx, const short* __restrict gy, int width,
                   ushort* __restrict magnitude) {
  for (int x = 0; x < width; ++x)
    magnitude[x] = static_cast<ushort>(std::abs(gx[x]) + std::abs(gy[x]));
}

schar quarter(short value) {
  return static_cast<schar>(std::clamp<short>(static_cast<short>(value / 4), -127, 127));
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void packCoarsely(const short* __restrict gx, const short* __restrict gy, int width,
                  schar* __restrict coarse) {
  for (int x = 0; x < width; ++x) {
    coarse[2 * x] = quarter(gx[x]);
    coarse[2 * x + 1] = quarter(gy[x]);
  }
}

/// An image of zeros with a margin of zeros. No cv::Mat::zeros, whose expression is set up at its
/// first use, in a way that ThreadSanitizer cannot follow into OpenCV.
cv::Mat coarseZeros(cv::Size size) {
  constexpr int kMargin = GradientImage::kCoarseMargin;
  const cv::Mat padded(size.height + 2 * kMargin, size.width + 2 * kMargin, CV_8SC2,
                       cv::Scalar::all(0));
  return padded(cv::Rect({kMargin, kMargin}, size));
}

}  // namespace

void computeGradient(const cv::Mat& image, GradientImage* gradient) {
  cv::GaussianBlur(image, gradient->smooth, cv::Size(5, 5), 1.0, 1.0,
                   cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
  cv::spatialGradient(gradient->smooth, gradient->gx, gradient->gy, 3, cv::BORDER_REPLICATE);
  gradient->magnitude.create(image.size(), CV_16UC1);
  if (gradient->coarse.size() != image.size()) gradient->coarse = coarseZeros(image.size());
  for (int y = 0; y < image.rows; ++y) {
    const short* gx = gradient->gx.ptr<short>(y);
    const short* gy = gradient->gy.ptr<short>(y);
    sumMagnitudes(gx, gy, image.cols, gradient->magnitude.ptr<ushort>(y));
    packCoarsely(gx, gy, image.cols, gradient->coarse.ptr<schar>(y));
  }
}

}  // namespace point_line_odometry
