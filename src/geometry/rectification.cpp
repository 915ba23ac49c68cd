#include "point_line_odometry/rectification.h"

#include <cstddef>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "geometry/raw_camera.h"

namespace point_line_odometry {
namespace {

/// Focal lengths and principal points of the two P matrices may differ by rounding only [px].
constexpr double kSameCamera_px = 0.01;
constexpr double kMinBaseline_m = 1e-6;

void requireSizes(const StereoCalibration& calibration) {
  const CameraCalibration& left = calibration.left;
  const CameraCalibration& right = calibration.right;
  for (const CameraCalibration* camera : {&left, &right}) {
    if (camera->width > 0 && camera->height > 0) continue;
    refuseCalibration(camera == &left ? "left" : "right", " camera: the size is ", camera->width,
                      " x ", camera->height,
                      ": give width and height of the images in the calibration");
  }
  if (left.width != right.width || left.height != right.height) {
    refuseCalibration("the left image is calibrated for ", left.width, " x ", left.height,
                      ", the right for ", right.width, " x ", right.height,
                      ": both must have the same size");
  }
}

void requireSameCamera(const CameraCalibration& left, const CameraCalibration& right) {
  const Eigen::Matrix3d difference = left.P.leftCols<3>() - right.P.leftCols<3>();
  if (difference.cwiseAbs().maxCoeff() > kSameCamera_px) {
    refuseCalibration("P of the left and right camera differ (fx ", left.P(0, 0), " and ",
                      right.P(0, 0), ", cx ", left.P(0, 2), " and ", right.P(0, 2), ", cy ",
                      left.P(1, 2), " and ", right.P(1, 2),
                      "): they must come from one stereo calibration with zero disparity");
  }
}

void requireBaseline(const StereoCalibration& calibration, double baseline_m) {
  if (baseline_m >= kMinBaseline_m) return;
  const double value = calibration.right.P(0, 3);
  if (baseline_m < -kMinBaseline_m) {
    refuseCalibration("P[3] of the right camera is ", value, ", which gives a baseline of ",
                      baseline_m, " m: swap left and right");
  }
  refuseCalibration(
      "P[3] of the right camera is ", value, ", which gives no baseline: it must be -fx * ",
      "baseline; calibrate the pair as a stereo pair (side by side, not one above the other)");
}

Eigen::Matrix<double, 3, 4> toEigen34(const cv::Mat& P) {
  Eigen::Matrix<double, 3, 4> result;
  cv::cv2eigen(P, result);
  return result;
}

/// As StereoCamera::raw_rows, along the middle column; 1 if only P is given, of rectified images.
double rawRows(const CameraCalibration& left) {
  constexpr double kMost = 10.0;
  constexpr double kLeast = 0.1;  // of an image that is not turned by about 90 degrees
  Eigen::Matrix2Xd ends(2, 2);
  ends << 0.5 * left.width, 0.5 * left.width, 0.0, left.height;
  try {
    const Eigen::Matrix2Xd raw = rawPixels(left, ends);
    const double rows = (raw(1, 1) - raw(1, 0)) / left.height;
    if (std::abs(rows) < kMost) return std::abs(rows) > kLeast ? rows : 0.0;
  } catch (const std::invalid_argument&) {
  }
  return 1.0;
}

}  // namespace

StereoCamera rectifiedCamera(const StereoCalibration& calibration) {
  requireProjection(calibration.left, "left");
  requireProjection(calibration.right, "right");
  requireSizes(calibration);
  requireSameCamera(calibration.left, calibration.right);
  const auto& P = calibration.left.P;
  StereoCamera camera;
  camera.fx = P(0, 0);
  camera.fy = P(1, 1);
  camera.cx = P(0, 2);
  camera.cy = P(1, 2);
  camera.baseline_m = (P(0, 3) - calibration.right.P(0, 3)) / camera.fx;
  camera.width = calibration.left.width;
  camera.height = calibration.left.height;
  camera.raw_rows = rawRows(calibration.left);
  requireBaseline(calibration, camera.baseline_m);
  camera.validate();
  return camera;
}

Eigen::Isometry3d poseOfRightInLeft(const StereoCalibration& calibration) {
  Eigen::Isometry3d T_rectified_left = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_rectified_right = Eigen::Isometry3d::Identity();
  T_rectified_left.linear() = calibration.left.R;
  T_rectified_right.linear() = calibration.right.R;
  T_rectified_right.translation().x() = rectifiedCamera(calibration).baseline_m;
  return T_rectified_left.inverse() * T_rectified_right;
}

StereoCalibration rectifyCalibration(StereoCalibration calibration,
                                     const Eigen::Isometry3d& T_right_left) {
  requireSizes(calibration);
  const OpenCvCamera left = toOpenCv(calibration.left, "left");
  const OpenCvCamera right = toOpenCv(calibration.right, "right");
  if (left.fisheye != right.fisheye) {
    refuseCalibration("the left camera's distortion_model is ", calibration.left.distortion_model,
                      ", the right's ", calibration.right.distortion_model,
                      ": both must be of one kind");
  }
  const double distance_m = T_right_left.translation().norm();
  if (!T_right_left.matrix().allFinite() || distance_m < kMinBaseline_m) {
    refuseCalibration("the cameras are ", distance_m,
                      " m apart: give the pose of each camera of the pair");
  }
  const cv::Size size(calibration.left.width, calibration.left.height);
  cv::Matx33d R;
  cv::Vec3d t;
  cv::eigen2cv(Eigen::Matrix3d(T_right_left.linear()), R);
  cv::eigen2cv(Eigen::Vector3d(T_right_left.translation()), t);
  cv::Mat R1, R2, P1, P2, Q;
  if (left.fisheye) {
    cv::fisheye::stereoRectify(left.K, left.D, right.K, right.D, size, R, t, R1, R2, P1, P2, Q,
                               cv::CALIB_ZERO_DISPARITY, size);
  } else {
    cv::stereoRectify(left.K, left.D, right.K, right.D, size, R, t, R1, R2, P1, P2, Q,
                      cv::CALIB_ZERO_DISPARITY, 0.0, size);
  }
  cv::cv2eigen(R1, calibration.left.R);
  cv::cv2eigen(R2, calibration.right.R);
  calibration.left.P = toEigen34(P1);
  calibration.right.P = toEigen34(P2);
  return calibration;
}

StereoRectifier::StereoRectifier(const StereoCalibration& calibration)
    : camera_(rectifiedCamera(calibration)), R_rectified_raw_(calibration.left.R) {
  const std::array<const CameraCalibration*, 2> cameras{&calibration.left, &calibration.right};
  const std::array<const char*, 2> sides{"left", "right"};
  const cv::Size size(camera_.width, camera_.height);
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const OpenCvCamera raw = toOpenCv(*cameras[i], sides[i]);
    requireRotation(*cameras[i], sides[i]);
    cv::Matx33d R;
    cv::Matx33d P;
    cv::eigen2cv(cameras[i]->R, R);
    cv::eigen2cv(Eigen::Matrix3d(cameras[i]->P.leftCols<3>()), P);
    if (raw.fisheye) {
      cv::fisheye::initUndistortRectifyMap(raw.K, raw.D, R, P, size, CV_16SC2, maps_[i].xy,
                                           maps_[i].weight);
    } else {
      cv::initUndistortRectifyMap(raw.K, raw.D, R, P, size, CV_16SC2, maps_[i].xy, maps_[i].weight);
    }
    const cv::Mat all(size, CV_8UC1, cv::Scalar(255));
    cv::Mat mean;
    cv::remap(all, mean, maps_[i].xy, maps_[i].weight, cv::INTER_LINEAR, cv::BORDER_CONSTANT);
    const cv::Mat seen = mean == 255;
    // No feature lies so near to the border that it is seen by a few pixels there.
    constexpr int kRim = 4;
    const cv::Rect inner = cv::Rect(kRim, kRim, size.width - 2 * kRim, size.height - 2 * kRim) &
                           cv::Rect({0, 0}, size);
    if (cv::countNonZero(seen(inner)) < inner.area()) maps_[i].seen = seen;
  }
}

/// A pixel is 0 if it is interpolated from one that is, or from none.
cv::Mat StereoRectifier::rectifyMask(const cv::Mat& raw, const Maps& maps) {
  if (raw.empty()) return maps.seen;
  if (raw.type() != CV_8UC1 || raw.size() != maps.xy.size()) {
    refuseCalibration("a mask to be rectified is ", raw.cols, " x ", raw.rows, " with ",
                      raw.channels(), " channel(s) of ", 8 * raw.elemSize1(),
                      " bit, but must be 8 bit grey and of the images' ", maps.xy.cols, " x ",
                      maps.xy.rows);
  }
  cv::Mat mean;
  cv::remap(raw != 0, mean, maps.xy, maps.weight, cv::INTER_LINEAR, cv::BORDER_CONSTANT,
            cv::Scalar(255));
  const cv::Mat allowed = mean == 255;
  return maps.seen.empty() ? allowed : cv::Mat(allowed & maps.seen);
}

StereoImages StereoRectifier::rectify(const StereoImages& raw) const {
  const cv::Size size(camera_.width, camera_.height);
  for (const cv::Mat* image : {&raw.left, &raw.right}) {
    if (image->type() != CV_8UC1 || image->size() != size) {
      refuseCalibration("an image to be rectified is ", image->cols, " x ", image->rows, " with ",
                        image->channels(), " channel(s) of ", 8 * image->elemSize1(),
                        " bit, but must be 8 bit grey and ", size.width, " x ", size.height,
                        " as in the calibration");
    }
  }
  StereoImages rectified;
  rectified.stamp_ns = raw.stamp_ns;
  rectified.left_mask = rectifyMask(raw.left_mask, maps_[0]);
  rectified.right_mask = rectifyMask(raw.right_mask, maps_[1]);
  const std::array<const cv::Mat*, 2> from{&raw.left, &raw.right};
  const std::array<cv::Mat*, 2> to{&rectified.left, &rectified.right};
  cv::parallel_for_(cv::Range(0, 2), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) {
      const auto k = static_cast<std::size_t>(i);
      cv::remap(*from[k], *to[k], maps_[k].xy, maps_[k].weight, cv::INTER_LINEAR);
    }
  });
  return rectified;
}

}  // namespace point_line_odometry
