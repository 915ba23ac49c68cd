#include "motion/corrected_calibration.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <stdexcept>

#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kFocal_px = 500.0;

/// A pair with a baseline of 0.2 m whose images are rectified already.
StereoCalibration rectifiedPair() {
  CameraCalibration camera;
  camera.width = 640;
  camera.height = 480;
  camera.K << kFocal_px, 0.0, 320.0, 0.0, kFocal_px, 240.0, 0.0, 0.0, 1.0;
  camera.P.leftCols<3>() = camera.K;
  StereoCalibration pair{camera, camera};
  pair.right.P(0, 3) = -kFocal_px * 0.2;
  return pair;
}

/// The pair of a wide lens: raw images.
StereoCalibration rawPair(const char* model) {
  StereoCalibration pair = rectifiedPair();
  for (CameraCalibration* camera : {&pair.left, &pair.right}) {
    camera->distortion_model = model;
    camera->D = {-0.2, 0.04, 1e-3, -5e-4, 0.0};
    if (camera->distortion_model == "equidistant") camera->D = {-0.01, 0.005, 0.0, 0.0};
  }
  pair.right.R = expSO3(Vector3d(0.01, -0.02, 0.005));
  return pair;
}

/// Where a raw camera sees the direction of a rectified pixel.
cv::Point2d project(const CameraCalibration& camera, const Vector2d& rectified_px) {
  const Vector3d ray =
      camera.R.transpose() * camera.P.leftCols<3>().inverse() * rectified_px.homogeneous();
  cv::Matx33d K;
  cv::eigen2cv(camera.K, K);
  std::vector<cv::Point2d> pixel;
  const std::vector<cv::Point3d> point{{ray.x(), ray.y(), ray.z()}};
  const std::vector<double> D = camera.D.empty() ? std::vector<double>(4, 0.0) : camera.D;
  if (camera.distortion_model == "equidistant") {
    cv::fisheye::projectPoints(point, pixel, cv::Vec3d(), cv::Vec3d(), K, D);
  } else {
    cv::projectPoints(point, cv::Vec3d(), cv::Vec3d(), K, D, pixel);
  }
  return pixel.front();
}

/// The displacement if the right camera is really another one: found by Newton's method with unit
/// Jacobian, as rectified and raw pixels are about alike.
RightDisplacement displacementBy(const CameraCalibration& given, const CameraCalibration& real) {
  return [given, real](const Vector2d& right_px) {
    const cv::Point2d raw = project(given, right_px);
    Vector2d corrected = right_px;
    for (int i = 0; i < 50; ++i) {
      const cv::Point2d error = project(real, corrected) - raw;
      corrected -= Vector2d(error.x, error.y);
    }
    return corrected;
  };
}

/// Largest distance of what both cameras see at rectified pixels.
double largestDifference_px(const CameraCalibration& a, const CameraCalibration& b) {
  double largest = 0.0;
  for (double x = 5.0; x < 640.0; x += 45.0) {
    for (double y = 5.0; y < 480.0; y += 47.0) {
      largest = std::max(largest, cv::norm(project(a, {x, y}) - project(b, {x, y})));
    }
  }
  return largest;
}

CameraCalibration changed(CameraCalibration camera) {
  camera.R = expSO3(Vector3d(0.002, -0.003, 0.004)) * camera.R;
  camera.K(0, 0) *= 1.004;
  camera.K(1, 1) *= 1.002;
  camera.K(0, 2) += 2.0;
  camera.K(1, 2) -= 1.0;
  if (camera.distortion_model == "equidistant") return camera;
  if (camera.D.empty()) camera.D.assign(5, 0.0);
  camera.D[2] += 1e-3;
  camera.D[3] -= 2e-3;
  return camera;
}

void expectRecovered(const StereoCalibration& given) {
  const CameraCalibration real = changed(given.right);
  const CorrectedCalibration corrected =
      correctedCalibration(given, displacementBy(given.right, real));
  EXPECT_GT(largestDifference_px(given.right, real), 3.0);
  EXPECT_LT(largestDifference_px(corrected.calibration.right, real), 0.02);
  EXPECT_GT(corrected.change.max_px, 3.0);
  EXPECT_LT(corrected.remaining.max_px, 0.02);
  EXPECT_LE(corrected.remaining.rms_px, corrected.remaining.max_px);
  EXPECT_EQ(corrected.calibration.left.K, given.left.K);
  EXPECT_EQ(corrected.calibration.left.D, given.left.D);
  EXPECT_EQ(corrected.calibration.right.P, given.right.P);
  EXPECT_TRUE(
      (corrected.calibration.right.R * corrected.calibration.right.R.transpose()).isIdentity(1e-9));
}

TEST(CorrectedCalibration, RecoversTheCameraOfRectifiedImages) { expectRecovered(rectifiedPair()); }

TEST(CorrectedCalibration, RecoversTheCameraOfRawImages) {
  for (const char* model : {"plumb_bob", "equidistant"}) {
    SCOPED_TRACE(model);
    expectRecovered(rawPair(model));
  }
  StereoCalibration rational = rawPair("rational_polynomial");
  for (CameraCalibration* camera : {&rational.left, &rational.right}) camera->D.resize(8, 0.0);
  expectRecovered(rational);
}

TEST(CorrectedCalibration, NoDisplacementChangesNothing) {
  for (const StereoCalibration& given : {rectifiedPair(), rawPair("equidistant")}) {
    const CorrectedCalibration corrected =
        correctedCalibration(given, [](const Vector2d& pixel) { return pixel; });
    EXPECT_EQ(corrected.change.max_px, 0.0);
    EXPECT_LT(corrected.remaining.max_px, 1e-9);
    EXPECT_LT(largestDifference_px(corrected.calibration.right, given.right), 1e-6);
  }
}

/// A shift by one pixel in rows is a pitch of 1 / f, or a principal point that is off by it.
TEST(CorrectedCalibration, AShiftByHand) {
  const StereoCalibration given = rectifiedPair();
  const CorrectedCalibration corrected = correctedCalibration(
      given, [](const Vector2d& pixel) { return Vector2d(pixel.x(), pixel.y() - 1.0); });
  EXPECT_NEAR(corrected.change.rms_px, 1.0, 1e-9);
  EXPECT_NEAR(corrected.change.max_px, 1.0, 1e-9);
  EXPECT_LT(corrected.remaining.max_px, 0.01);
  const cv::Point2d seen = project(corrected.calibration.right, {100.0, 200.0});
  EXPECT_NEAR(seen.x, 100.0, 0.01);
  EXPECT_NEAR(seen.y, 201.0, 0.01);
}

/// Columns that depend on rows as rows on columns are a shear, which no camera_info has.
TEST(CorrectedCalibration, SaysWhatRemains) {
  const CorrectedCalibration corrected =
      correctedCalibration(rectifiedPair(), [](const Vector2d& pixel) {
        return Vector2d(pixel.x() + (pixel.y() - 240.0) / 240.0,
                        pixel.y() + (pixel.x() - 320.0) / 240.0);
      });
  EXPECT_GT(corrected.remaining.rms_px, 0.3);
  EXPECT_LT(corrected.remaining.rms_px, corrected.change.rms_px + 1e-9);
}

TEST(CorrectedCalibration, RefusesWhatCannotBeRectified) {
  StereoCalibration bad = rectifiedPair();
  bad.right.D = {0.1};
  EXPECT_THROW(correctedCalibration(bad, [](const Vector2d& pixel) { return pixel; }),
               std::invalid_argument);
}

}  // namespace
}  // namespace point_line_odometry
