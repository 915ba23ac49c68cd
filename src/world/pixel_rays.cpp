#include "world/pixel_rays.h"

#include <algorithm>
#include <cmath>
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

/// Directions (X, Y, 1) of pixels through K and the four coefficients of Kannala and Brandt's
/// model, theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8), which rises on real lenses: by
/// bisection.
std::vector<cv::Point2d> undistortFisheye(const std::vector<cv::Point2d>& pixels,
                                          const CameraCalibration& calibration) {
  constexpr double kMaxAngle_rad = 75.0 * M_PI / 180.0;
  const auto distorted = [&D = calibration.D](double theta) {
    const double t = theta * theta;
    return theta * (1.0 + t * (D[0] + t * (D[1] + t * (D[2] + t * D[3]))));
  };
  const auto& K = calibration.K;
  std::vector<cv::Point2d> directions;
  for (const cv::Point2d& pixel : pixels) {
    const cv::Point2d p((pixel.x - K(0, 2)) / K(0, 0), (pixel.y - K(1, 2)) / K(1, 1));
    const double radius = std::hypot(p.x, p.y);
    double low = 0.0;
    double high = kMaxAngle_rad;
    for (int i = 0; i < 40; ++i) {
      const double middle = 0.5 * (low + high);
      (distorted(middle) < radius ? low : high) = middle;
    }
    directions.push_back(radius > 0.0 ? p * (std::tan(low) / radius) : p);
  }
  return directions;
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
    if (calibration.distortion_model == "equidistant") {
      undistorted = undistortFisheye(row, calibration);
    } else {
      cv::undistortPoints(row, undistorted, K, calibration.D, cv::noArray(), cv::noArray(),
                          converged);
    }
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
