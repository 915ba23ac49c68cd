#include "point_line_odometry/feature_overlay.h"

#include <cstdio>
#include <opencv2/imgproc.hpp>

namespace point_line_odometry {
namespace {

constexpr double kMaskedBrightness = 0.35;

constexpr int kShift = 4;  // fractional bits of the drawing coordinates

const cv::Scalar kYellow(0, 255, 255);
const cv::Scalar kDimYellow(0, 140, 140);
const cv::Scalar kRed(0, 0, 255);
const cv::Scalar kDimRed(60, 60, 150);
const cv::Scalar kBlue(255, 120, 0);

cv::Point fixedPoint(const Eigen::Vector2f& pixel) {
  return {cvRound(pixel.x() * (1 << kShift)), cvRound(pixel.y() * (1 << kShift))};
}

void drawSegment(const LineSegment& segment, const cv::Scalar& colour, int width, cv::Mat* image) {
  cv::line(*image, fixedPoint(segment.start), fixedPoint(segment.end), colour, width, cv::LINE_AA,
           kShift);
}

void drawPoint(const Eigen::Vector2f& pixel, const cv::Scalar& colour, cv::Mat* image) {
  cv::circle(*image, fixedPoint(pixel), 2 << kShift, colour, 1, cv::LINE_AA, kShift);
}

void drawCross(const Eigen::Vector2f& pixel, const cv::Scalar& colour, cv::Mat* image) {
  cv::drawMarker(*image, cv::Point(cvRound(pixel.x()), cvRound(pixel.y())), colour,
                 cv::MARKER_TILTED_CROSS, 7, 1, cv::LINE_AA);
}

void drawText(const FrameResult& result, cv::Mat* image) {
  std::array<char, 160> text{};
  const bool explain = result.reason != TrackingReason::kNone;
  std::snprintf(text.data(), text.size(), "%s%s%s  points %d/%d  lines %d/%d  %.1f ms",
                toString(result.state), explain ? ": " : "", explain ? toString(result.reason) : "",
                result.counts.point_inliers, result.counts.point_matches,
                result.counts.line_inliers, result.counts.line_matches, result.times.total_ms);
  const cv::Point origin(8, image->rows - 10);
  cv::putText(*image, text.data(), origin, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar(0, 0, 0), 3,
              cv::LINE_AA);
  cv::putText(*image, text.data(), origin, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar(255, 255, 255),
              1, cv::LINE_AA);
}

}  // namespace

cv::Mat drawFeatures(const cv::Mat& left, const FrameResult& result, const cv::Mat& mask) {
  cv::Mat image;
  cv::cvtColor(left, image, cv::COLOR_GRAY2BGR);
  if (mask.size() == left.size()) cv::Mat(image * kMaskedBrightness).copyTo(image, mask == 0);
  for (const LineSegment& segment : result.unmatched_lines_px)
    drawSegment(segment, kDimRed, 1, &image);
  for (const Eigen::Vector2f& pixel : result.unmatched_points_px)
    drawPoint(pixel, kDimYellow, &image);
  for (const ObservedLine& line : result.lines) {
    drawSegment(line.left_px, line.inlier ? kRed : kBlue, line.inlier ? 2 : 1, &image);
  }
  for (const ObservedPoint& point : result.points) {
    if (point.inlier) {
      drawPoint(point.left_px, kYellow, &image);
    } else {
      drawCross(point.left_px, kBlue, &image);
    }
  }
  drawText(result, &image);
  return image;
}

}  // namespace point_line_odometry
