#include "common/image_resize.h"

#include <opencv2/imgproc.hpp>

namespace point_line_odometry {
namespace {

bool isSmaller(const cv::Size& size, const cv::Mat& image) { return size.width < image.cols; }

}  // namespace

cv::Mat resized(const cv::Mat& image, const cv::Size& size) {
  cv::Mat result;
  cv::resize(image, result, size, 0.0, 0.0,
             isSmaller(size, image) ? cv::INTER_AREA : cv::INTER_CUBIC);
  return result;
}

cv::Mat resizedMask(const cv::Mat& mask, const cv::Size& size) {
  constexpr int kCubicSide = 5;  // pixels of the input around one that cubic interpolation may use
  if (mask.empty()) return {};
  const cv::Mat used = mask != 0;
  if (isSmaller(size, mask)) return resized(used, size) == 255;
  cv::Mat result;
  cv::erode(used, result, cv::Mat(kCubicSide, kCubicSide, CV_8UC1, cv::Scalar(1)));
  cv::resize(result, result, size, 0.0, 0.0, cv::INTER_NEAREST);
  return result;
}

}  // namespace point_line_odometry
