#include "geometry/raw_camera.h"

#include <Eigen/LU>
#include <cmath>
#include <cstddef>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <string>
#include <vector>

namespace point_line_odometry {
namespace {

/// Largest deviation of R R^T from the identity.
constexpr double kOrthonormal = 1e-3;

void requireIntrinsics(const CameraCalibration& camera, const char* side) {
  const Eigen::Matrix3d& K = camera.K;
  if (!K.allFinite() || !(K(0, 0) > 0.0) || !(K(1, 1) > 0.0)) {
    refuseCalibration(
        side, " camera: K has focal lengths ", K(0, 0), " and ", K(1, 1),
        ", but images can be rectified only with a calibrated K: calibrate the camera");
  }
}

bool isAllowedCount(const std::string& model, std::size_t count) {
  if (count == 0) return true;
  if (model == "plumb_bob") return count == 4 || count == 5;
  if (model == "equidistant") return count == 4;
  return count == 8 || count == 12 || count == 14;
}

}  // namespace

OpenCvCamera toOpenCv(const CameraCalibration& camera, const char* side) {
  const std::string& model = camera.distortion_model;
  const bool undistorted = camera.D.empty() && model.empty();
  if (!undistorted && model != "plumb_bob" && model != "rational_polynomial" &&
      model != "equidistant") {
    refuseCalibration(side, " camera: distortion_model '", model,
                      "' is unknown: use plumb_bob, rational_polynomial or equidistant");
  }
  if (!isAllowedCount(model, camera.D.size())) {
    refuseCalibration(side, " camera: D has ", camera.D.size(),
                      " coefficients, which does not fit ", model,
                      ": plumb_bob takes 4 or 5, rational_polynomial 8, equidistant 4");
  }
  for (const double coefficient : camera.D) {
    if (!std::isfinite(coefficient))
      refuseCalibration(side, " camera: D is not finite: calibrate the camera");
  }
  requireIntrinsics(camera, side);
  OpenCvCamera result;
  cv::eigen2cv(camera.K, result.K);
  result.fisheye = model == "equidistant";
  const std::vector<double> none(result.fisheye ? 4 : 5, 0.0);
  result.D = cv::Mat(camera.D.empty() ? none : camera.D, true);
  return result;
}

void requireRotation(const CameraCalibration& camera, const char* side) {
  const Eigen::Matrix3d deviation = camera.R * camera.R.transpose() - Eigen::Matrix3d::Identity();
  if (!camera.R.allFinite() || deviation.norm() > kOrthonormal || camera.R.determinant() <= 0.0) {
    refuseCalibration(side, " camera: R is not a rotation: calibrate the stereo pair again");
  }
}

void requireProjection(const CameraCalibration& camera, const char* side) {
  const auto& P = camera.P;
  if (!P.allFinite())
    refuseCalibration(side, " camera: P has values that are not finite: calibrate the pair");
  if (P.isZero(0.0)) {
    refuseCalibration(
        side, " camera: P is all zero: the camera is not calibrated; calibrate the stereo pair");
  }
  if (!(P(0, 0) > 0.0) || !(P(1, 1) > 0.0)) {
    refuseCalibration(side, " camera: P has focal lengths ", P(0, 0), " and ", P(1, 1),
                      ", but they must be above 0: calibrate the stereo pair");
  }
  if (!P.row(2).isApprox(Eigen::RowVector4d(0.0, 0.0, 1.0, 0.0))) {
    refuseCalibration(side, " camera: the third row of P is ", P.row(2),
                      ", but must be 0 0 1 0: calibrate the stereo pair");
  }
}

Eigen::Matrix2Xd rawPixels(const CameraCalibration& camera, const Eigen::Matrix2Xd& rectified) {
  const OpenCvCamera raw = toOpenCv(camera, "raw");
  requireRotation(camera, "raw");
  requireProjection(camera, "raw");
  Eigen::Matrix2Xd pixels(2, rectified.cols());
  if (rectified.cols() == 0) return pixels;
  const Eigen::Matrix3d rays = camera.R.transpose() * camera.P.leftCols<3>().inverse();
  std::vector<cv::Point3d> points;
  points.reserve(static_cast<std::size_t>(rectified.cols()));
  for (Eigen::Index i = 0; i < rectified.cols(); ++i) {
    const Eigen::Vector3d ray = rays * rectified.col(i).homogeneous();
    points.emplace_back(ray.x(), ray.y(), ray.z());
  }
  std::vector<cv::Point2d> projected;
  const cv::Vec3d none(0.0, 0.0, 0.0);
  if (raw.fisheye) {
    cv::fisheye::projectPoints(points, projected, none, none, raw.K, raw.D);
  } else {
    cv::projectPoints(points, none, none, raw.K, raw.D, projected);
  }
  for (Eigen::Index i = 0; i < pixels.cols(); ++i) {
    const cv::Point2d& pixel = projected[static_cast<std::size_t>(i)];
    pixels.col(i) << pixel.x, pixel.y;
  }
  return pixels;
}

}  // namespace point_line_odometry
