#include "tools/calibration_image.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <string>

namespace point_line_odometry {
namespace {

constexpr int kShift = 4;         // fractional bits of the drawing coordinates
constexpr int kWidth_px = 1240;   // of the drawing
constexpr int kLegend_px = 56;    // height of the text below the images
constexpr double kDimming = 0.5;  // of the images
const cv::Scalar kGreen(90, 255, 90);
const cv::Scalar kOrange(0, 165, 255);
const cv::Scalar kGrey(150, 150, 150);
const cv::Scalar kWhite(255, 255, 255);

cv::Point fixedPoint(const Eigen::Vector2d& pixel) {
  return {cvRound(pixel.x() * (1 << kShift)), cvRound(pixel.y() * (1 << kShift))};
}

/// A camera's image with its arrows.
class Panel {
 public:
  /// \param arrow_scale pixels of the drawing for a pixel of residual.
  Panel(const cv::Mat& image, double arrow_scale) : arrow_scale_(arrow_scale) {
    scale_ = static_cast<double>(kWidth_px) / image.cols;
    cv::Mat grey;
    cv::resize(image, grey, cv::Size(kWidth_px, std::max(1, cvRound(scale_ * image.rows))), 0.0,
               0.0, scale_ < 1.0 ? cv::INTER_AREA : cv::INTER_LINEAR);
    cv::cvtColor(grey * kDimming, canvas_, cv::COLOR_GRAY2BGR);
  }

  void drawArrow(const Eigen::Vector2d& at_px, const Eigen::Vector2d& residual_px,
                 const cv::Scalar& colour) {
    const Eigen::Vector2d from = scale_ * at_px;
    const Eigen::Vector2d to = from + arrow_scale_ * residual_px;
    const double length = (to - from).norm();
    cv::circle(canvas_, fixedPoint(from), 2 << kShift, colour, cv::FILLED, cv::LINE_AA, kShift);
    if (length < 1.0) return;
    constexpr double kTip_px = 6.0;
    cv::arrowedLine(canvas_, fixedPoint(from), fixedPoint(to), colour, 2, cv::LINE_AA, kShift,
                    std::min(0.5, kTip_px / length));
  }

  void drawDot(const Eigen::Vector2d& at_px) {
    cv::circle(canvas_, fixedPoint(scale_ * at_px), 1 << kShift, kGrey, cv::FILLED, cv::LINE_AA,
               kShift);
  }

  void drawText(const std::string& text) {
    for (const auto& [colour, width] : {std::make_pair(cv::Scalar(), 3), {kWhite, 1}}) {
      cv::putText(canvas_, text, cv::Point(8, 20), cv::FONT_HERSHEY_SIMPLEX, 0.5, colour, width,
                  cv::LINE_AA);
    }
  }

  const cv::Mat& canvas() const { return canvas_; }

 private:
  double arrow_scale_;
  double scale_ = 1.0;
  cv::Mat canvas_;
};

double largestArrow_px(const CalibrationReport& report) {
  double largest = std::max(report.left.size().max_px, report.right.size().max_px);
  for (const Eigen::Vector2d& displacement : report.estimated_px) {
    largest = std::max(largest, displacement.norm());
  }
  return largest;
}

/// The longest of 1, 2, 5 times a power of ten that is not longer than a residual, but 0.05 px at
/// least: a good calibration shall not look bad.
double legendOf(double largest_px) {
  constexpr double kLeast_px = 0.05;
  const double wanted = std::max(largest_px, kLeast_px);
  const double power = std::pow(10.0, std::floor(std::log10(wanted)));
  for (const double factor : {5.0, 2.0}) {
    if (factor * power <= wanted) return factor * power;
  }
  return power;
}

void drawField(const ResidualField& field, Panel* panel) {
  for (const ResidualCell& cell : field.cells) {
    if (cell.points >= ResidualField::kFewestPoints) {
      panel->drawArrow(cell.centre_px, cell.residual_px, kGreen);
    } else {
      panel->drawDot(cell.centre_px);
    }
  }
}

cv::Mat drawLegend(double residual_px, double arrow_px) {
  cv::Mat legend(kLegend_px, kWidth_px, CV_8UC3, cv::Scalar(30, 30, 30));
  std::array<char, 80> text{};
  std::snprintf(text.data(), text.size(), "%g px", residual_px);
  const int end = 12 + cvRound(arrow_px);
  cv::arrowedLine(legend, {12, kLegend_px / 2}, {end, kLegend_px / 2}, kWhite, 2, cv::LINE_AA);
  const auto write = [&](const std::string& words, int x, int y, const cv::Scalar& colour) {
    cv::putText(legend, words, {x, y}, cv::FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv::LINE_AA);
  };
  write(text.data(), end + 12, kLegend_px / 2 + 5, kWhite);
  write("measured against the calibration (medians; grey dots: too few points)", 260, 22, kGreen);
  write("displacement of the right image that the online stereo calibration has estimated", 260, 44,
        kOrange);
  return legend;
}

}  // namespace

cv::Mat drawCalibration(const CalibrationReport& report) {
  const double legend_px = legendOf(largestArrow_px(report));
  const double cell_px = report.cell_px * kWidth_px / report.camera.width;
  const double arrow_scale = 0.9 * cell_px / std::max(largestArrow_px(report), legend_px);
  Panel left(report.last_left, arrow_scale);
  Panel right(report.last_right, arrow_scale);
  drawField(report.left, &left);
  for (std::size_t i = 0; i < report.right.cells.size(); ++i) {
    right.drawArrow(report.right.cells[i].centre_px, report.estimated_px[i], kOrange);
  }
  drawField(report.right, &right);
  left.drawText("left: reprojection residual");
  right.drawText("right: columns: reprojection residual; rows: vertical disparity");
  cv::Mat drawing;
  cv::vconcat(std::vector<cv::Mat>{left.canvas(), right.canvas(),
                                   drawLegend(legend_px, arrow_scale * legend_px)},
              drawing);
  return drawing;
}

}  // namespace point_line_odometry
