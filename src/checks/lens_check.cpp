#include "checks/lens_check.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace point_line_odometry {
namespace {

constexpr int kMostDisparity = 5;  // a fifth of the width
constexpr int kWindow = 12;        // a twelfth of the width

/// Standard deviation of the fine structure [grey levels] in a window around each pixel.
cv::Mat fineContrast(const cv::Mat& image, int window_px) {
  constexpr double kCoarse_px = 3.0;
  cv::Mat brightness;
  cv::Mat coarse;
  image.convertTo(brightness, CV_32F);
  cv::GaussianBlur(brightness, coarse, {}, kCoarse_px);
  cv::Mat contrast = brightness - coarse;
  cv::multiply(contrast, contrast, contrast);
  cv::boxFilter(contrast, contrast, CV_32F, {window_px, window_px});
  cv::sqrt(contrast, contrast);
  return contrast;
}

/// Where the window around a pixel has a masked one.
cv::Mat nearMasked(const cv::Mat& mask, int window_px) {
  cv::Mat whole;
  cv::erode(mask, whole, cv::Mat::ones(window_px, window_px, CV_8U));
  return whole == 0;
}

/// The share of the pixels in these columns whose contrast is below a third of the reference.
double lowShare(const cv::Mat& contrast, const cv::Mat& reference, const cv::Mat& excluded,
                const cv::Range& columns) {
  constexpr double kThird = 1.0 / 3.0;
  constexpr double kLeastContrast = 4.0;  // more than noise
  if (columns.end <= columns.start) return 0.0;
  cv::Mat compared = reference.colRange(columns) > kLeastContrast;
  if (!excluded.empty()) compared.setTo(0, excluded.colRange(columns));
  const cv::Mat low = contrast.colRange(columns) < kThird * reference.colRange(columns);
  return static_cast<double>(cv::countNonZero(low & compared)) /
         static_cast<double>(compared.total());
}

}  // namespace

LensMeasurement measureLenses(const cv::Mat& left, const cv::Mat& right, const cv::Mat& left_mask,
                              const cv::Mat& right_mask) {
  const int width = left.cols;
  const int most_px = width / kMostDisparity;
  const int window_px = std::max(width / kWindow, 1);
  const cv::Mat left_contrast = fineContrast(left, window_px);
  const cv::Mat right_contrast = fineContrast(right, window_px);
  // The least contrast from the same column to the greatest disparity.
  const cv::Mat span = cv::Mat::ones(1, most_px + 1, CV_8U);
  cv::Mat left_reference;
  cv::Mat right_reference;
  cv::erode(right_contrast, left_reference, span, {most_px, 0});
  cv::erode(left_contrast, right_reference, span, {0, 0});
  cv::Mat left_excluded;
  cv::Mat right_excluded;
  if (!left_mask.empty()) left_excluded = nearMasked(left_mask, window_px);
  if (!right_mask.empty()) right_excluded = nearMasked(right_mask, window_px);
  return {lowShare(left_contrast, left_reference, left_excluded, {most_px, width}),
          lowShare(right_contrast, right_reference, right_excluded, {0, width - most_px})};
}

}  // namespace point_line_odometry
