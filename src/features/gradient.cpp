#include <algorithm>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "common/processor_clones.h"
#include "point_line_odometry/line_detector.h"

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

}  // namespace

void computeGradient(const cv::Mat& image, GradientImage* gradient) {
  cv::GaussianBlur(image, gradient->smooth, cv::Size(5, 5), 1.0, 1.0,
                   cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
  cv::spatialGradient(gradient->smooth, gradient->gx, gradient->gy, 3, cv::BORDER_REPLICATE);
  gradient->magnitude.create(image.size(), CV_16UC1);
  gradient->coarse.create(image.size(), CV_8SC2);
  for (int y = 0; y < image.rows; ++y) {
    const short* gx = gradient->gx.ptr<short>(y);
    const short* gy = gradient->gy.ptr<short>(y);
    sumMagnitudes(gx, gy, image.cols, gradient->magnitude.ptr<ushort>(y));
    packCoarsely(gx, gy, image.cols, gradient->coarse.ptr<schar>(y));
  }
}

}  // namespace point_line_odometry
