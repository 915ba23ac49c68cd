#include "ros/calibration_conversion.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <string>

namespace point_line_odometry {
namespace {

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using RowMajor34 = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

[[noreturn]] void refuse(const std::string& field, double value, const std::string& hint) {
  std::ostringstream text;
  text << field << " is " << value << ": " << hint;
  throw MessageError(text.str());
}

constexpr const char* kCalibrate =
    "calibrate the stereo pair (camera_calibration) and load the result into the camera driver";

void checkProjection(const std::string& side, const CameraCalibration& camera) {
  const std::string name = side + "/camera_info: ";
  if (camera.width <= 0 || camera.height <= 0) {
    refuse(name + (camera.width <= 0 ? "width" : "height"),
           camera.width <= 0 ? camera.width : camera.height,
           "the driver must fill in the size of the calibrated image");
  }
  if (!camera.P.allFinite()) {
    throw MessageError(name + "P has an entry that is not a finite number: " + kCalibrate);
  }
  if (camera.P.isZero(0.0)) throw MessageError(name + "P is all zero: " + kCalibrate);
  if (camera.P(0, 0) <= 0.0) refuse(name + "P[0] (fx)", camera.P(0, 0), kCalibrate);
  if (camera.P(1, 1) <= 0.0) refuse(name + "P[5] (fy)", camera.P(1, 1), kCalibrate);
}

void checkPair(const StereoCalibration& pair) {
  if (pair.left.width != pair.right.width || pair.left.height != pair.right.height) {
    std::ostringstream text;
    text << "left/camera_info describes " << pair.left.width << " x " << pair.left.height
         << " pixels, right/camera_info " << pair.right.width << " x " << pair.right.height
         << "; both cameras must run at the same resolution";
    throw MessageError(text.str());
  }
  const double left_offset = pair.left.P(0, 3);
  const double right_offset = pair.right.P(0, 3);
  if (left_offset != 0.0) {
    refuse("left/camera_info: P[3]", left_offset,
           "it must be 0, left and right cameras are probably swapped; exchange "
           "the topics");
  }
  if (right_offset == 0.0) {
    refuse("right/camera_info: P[3] (-fx * baseline)", right_offset,
           "the baseline must be positive, so this is not a stereo calibration or "
           "both topics carry the left camera's info; check the remapping");
  }
  if (right_offset > 0.0) {
    refuse("right/camera_info: P[3] (-fx * baseline)", right_offset,
           "the baseline must be positive, left and right cameras are probably "
           "swapped; exchange the topics");
  }
}

/// Moves and scales the first two rows of K or P to the transmitted part of the image, as
/// image_geometry does (conversions_test); image_geometry itself does not check its input.
template <typename Matrix>
void applyWindow(const sensor_msgs::CameraInfo& info, Matrix* projection) {
  (*projection)(0, 2) -= info.roi.x_offset;
  (*projection)(1, 2) -= info.roi.y_offset;
  projection->row(0) /= std::max(1U, info.binning_x);
  projection->row(1) /= std::max(1U, info.binning_y);
}

CameraCalibration toCalibration(const sensor_msgs::CameraInfo& info) {
  CameraCalibration camera;
  camera.width = static_cast<int>((info.roi.width > 0 ? info.roi.width : info.width) /
                                  std::max(1U, info.binning_x));
  camera.height = static_cast<int>((info.roi.height > 0 ? info.roi.height : info.height) /
                                   std::max(1U, info.binning_y));
  camera.distortion_model = info.distortion_model;
  camera.D = info.D;
  camera.K = Eigen::Map<const RowMajor3>(info.K.data());
  camera.R = Eigen::Map<const RowMajor3>(info.R.data());
  camera.P = Eigen::Map<const RowMajor34>(info.P.data());
  applyWindow(info, &camera.K);
  applyWindow(info, &camera.P);
  return camera;
}

/// Equality with NaN == NaN, as an unused field may hold NaN.
template <typename Numbers>
bool sameNumbers(const Numbers& a, const Numbers& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](double x, double y) { return x == y || (std::isnan(x) && std::isnan(y)); });
}

}  // namespace

StereoCalibration toStereoCalibration(const sensor_msgs::CameraInfo& left,
                                      const sensor_msgs::CameraInfo& right) {
  StereoCalibration calibration{toCalibration(left), toCalibration(right)};
  checkProjection("left", calibration.left);
  checkProjection("right", calibration.right);
  checkPair(calibration);
  return calibration;
}

sensor_msgs::CameraInfo toCameraInfo(const CameraCalibration& calibration,
                                     const std_msgs::Header& header) {
  sensor_msgs::CameraInfo info;
  info.header = header;
  info.width = static_cast<std::uint32_t>(calibration.width);
  info.height = static_cast<std::uint32_t>(calibration.height);
  info.distortion_model = calibration.distortion_model;
  info.D = calibration.D;
  Eigen::Map<RowMajor3>(info.K.data()) = calibration.K;
  Eigen::Map<RowMajor3>(info.R.data()) = calibration.R;
  Eigen::Map<RowMajor34>(info.P.data()) = calibration.P;
  return info;
}

const char* differingField(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b) {
  if (a.width != b.width) return "width";
  if (a.height != b.height) return "height";
  if (a.distortion_model != b.distortion_model) return "distortion_model";
  if (!sameNumbers(a.D, b.D)) return "D";
  if (!sameNumbers(a.K, b.K)) return "K";
  if (!sameNumbers(a.R, b.R)) return "R";
  if (!sameNumbers(a.P, b.P)) return "P";
  if (a.binning_x != b.binning_x || a.binning_y != b.binning_y) return "binning";
  const auto& p = a.roi;
  const auto& q = b.roi;
  const bool same_roi = p.x_offset == q.x_offset && p.y_offset == q.y_offset &&
                        p.width == q.width && p.height == q.height;
  return same_roi ? nullptr : "roi";
}

bool sameCalibration(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b) {
  return differingField(a, b) == nullptr;
}

bool InfoPair::operator==(const InfoPair& other) const {
  return sameCalibration(*left, *other.left) && sameCalibration(*right, *other.right);
}

std::string differenceOf(const InfoPair& a, const InfoPair& b) {
  const char* const left = differingField(*a.left, *b.left);
  const char* const right = differingField(*a.right, *b.right);
  if (left != nullptr) return std::string("left/camera_info: ") + left;
  return std::string("right/camera_info: ") + (right != nullptr ? right : "nothing");
}

}  // namespace point_line_odometry
