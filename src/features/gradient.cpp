#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "point_line_odometry/line_detector.h"

namespace point_line_odometry {

void computeGradient(const cv::Mat& image, GradientImage* gradient) {
  cv::GaussianBlur(image, gradient->smooth, cv::Size(5, 5), 1.0, 1.0,
                   cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
  cv::spatialGradient(gradient->smooth, gradient->gx, gradient->gy, 3, cv::BORDER_REPLICATE);
  gradient->magnitude.create(image.size(), CV_16UC1);
  for (int y = 0; y < image.rows; ++y) {
    const short* gx = gradient->gx.ptr<short>(y);
    const short* gy = gradient->gy.ptr<short>(y);
    ushort* magnitude = gradient->magnitude.ptr<ushort>(y);
    for (int x = 0; x < image.cols; ++x) {
      magnitude[x] = static_cast<ushort>(std::abs(gx[x]) + std::abs(gy[x]));
    }
  }
}

}  // namespace point_line_odometry
