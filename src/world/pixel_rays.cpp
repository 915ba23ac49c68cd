#include "world/pixel_rays.h"

#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <vector>

namespace point_line_odometry::world {
namespace {

void include(const cv::Point2f& p, PlaneBounds* bounds) {
  bounds->x_low = std::min(bounds->x_low, p.x);
  bounds->x_high = std::max(bounds->x_high, p.x);
  bounds->y_low = std::min(bounds->y_low, p.y);
  bounds->y_high = std::max(bounds->y_high, p.y);
}

}  // namespace

PixelRays PixelRays::ofRawImage(const CameraCalibration& calibration) {
  PixelRays rays;
  rays.straight_ = calibration.D.empty();
  rays.corners_.create(calibration.height + 1, calibration.width + 1);
  cv::Mat K;
  cv::eigen2cv(calibration.K, K);
  std::vector<cv::Point2d> row(static_cast<std::size_t>(calibration.width) + 1);
  std::vector<cv::Point2d> undistorted;
  const cv::TermCriteria converged(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-9);
  for (int j = 0; j <= calibration.height; ++j) {
    for (int i = 0; i <= calibration.width; ++i) {
      row[static_cast<std::size_t>(i)] = {i - 0.5, j - 0.5};
    }
    cv::undistortPoints(row, undistorted, K, calibration.D, cv::noArray(), cv::noArray(),
                        converged);
    std::copy(undistorted.begin(), undistorted.end(), rays.corners_[j]);
  }
  return rays;
}

PixelRays PixelRays::ofRectifiedImage(const CameraCalibration& calibration) {
  PixelRays rays;
  rays.corners_.create(calibration.height + 1, calibration.width + 1);
  const auto& P = calibration.P;
  for (int j = 0; j <= calibration.height; ++j) {
    for (int i = 0; i <= calibration.width; ++i) {
      rays.corners_(j, i) =
          cv::Point2d((i - 0.5 - P(0, 2)) / P(0, 0), (j - 0.5 - P(1, 2)) / P(1, 1));
    }
  }
  return rays;
}

PlaneBounds PixelRays::bounds(const PixelBlock& b) const {
  const cv::Point2f& first = corner(b.x, b.y);
  PlaneBounds bounds{first.x, first.x, first.y, first.y};
  if (straight_) {
    include(corner(b.x + b.width, b.y + b.height), &bounds);
    return bounds;
  }
  for (int i = b.x; i <= b.x + b.width; ++i) {
    include(corner(i, b.y), &bounds);
    include(corner(i, b.y + b.height), &bounds);
  }
  for (int j = b.y; j <= b.y + b.height; ++j) {
    include(corner(b.x, j), &bounds);
    include(corner(b.x + b.width, j), &bounds);
  }
  return bounds;
}

}  // namespace point_line_odometry::world
