#include "ros/conversions.h"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <string>

namespace point_line_odometry {
namespace {

namespace encodings = sensor_msgs::image_encodings;

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using RowMajor34 = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

/// How an encoding is laid out in memory and how it becomes grey.
struct PixelFormat {
  const char* encoding;
  int cv_type;
  std::uint64_t bytes;
  int to_gray;  // code of cv::cvtColor, kShared or kHighByte
};

constexpr int kShared = -1;
constexpr int kHighByte = -2;

constexpr std::array<PixelFormat, 8> kPixelFormats{{
    {"mono8", CV_8UC1, 1, kShared},
    {"8UC1", CV_8UC1, 1, kShared},
    {"mono16", CV_8UC2, 2, kHighByte},
    {"16UC1", CV_8UC2, 2, kHighByte},
    {"bgr8", CV_8UC3, 3, cv::COLOR_BGR2GRAY},
    {"rgb8", CV_8UC3, 3, cv::COLOR_RGB2GRAY},
    {"bgra8", CV_8UC4, 4, cv::COLOR_BGRA2GRAY},
    {"rgba8", CV_8UC4, 4, cv::COLOR_RGBA2GRAY},
}};

std::string supportedEncodings() {
  std::string names;
  for (const PixelFormat& format : kPixelFormats) {
    names += (names.empty() ? "" : ", ") + std::string(format.encoding);
  }
  return names;
}

const PixelFormat& pixelFormat(const std::string& encoding) {
  const auto format = std::find_if(kPixelFormats.begin(), kPixelFormats.end(),
                                   [&](const PixelFormat& f) { return encoding == f.encoding; });
  if (format != kPixelFormats.end()) return *format;
  if (encodings::isBayer(encoding)) {
    throw MessageError("image: encoding '" + encoding +
                       "' is a raw Bayer pattern; run image_proc's debayer nodelet and subscribe "
                       "to its image_mono");
  }
  throw MessageError("image: encoding '" + encoding +
                     "' is not supported; convert the image to one of " + supportedEncodings());
}

/// Throws unless the pixel buffer is exactly what the header fields say.
void checkLayout(const sensor_msgs::Image& image, const PixelFormat& format) {
  std::ostringstream fault;
  const std::uint64_t row_bytes = image.width * format.bytes;
  const std::uint64_t all_bytes = static_cast<std::uint64_t>(image.step) * image.height;
  constexpr std::uint32_t kMaxSide = 1U << 16U;
  if (image.width == 0 || image.height == 0) {
    fault << "size is " << image.width << " x " << image.height << ", so it is empty";
  } else if (image.width > kMaxSide || image.height > kMaxSide) {
    fault << "size is " << image.width << " x " << image.height << ", larger than any camera's";
  } else if (image.step < row_bytes) {
    fault << "step is " << image.step << " bytes, but a row of " << image.width << " pixels in "
          << format.encoding << " takes " << row_bytes;
  } else if (image.data.size() != all_bytes) {
    fault << "data has " << image.data.size() << " bytes, but step x height is " << all_bytes;
  } else {
    return;
  }
  throw MessageError("image: " + fault.str() + "; check the driver that publishes it");
}

void checkImageSize(const char* side, const cv::Mat& image, const CameraCalibration& camera) {
  if (image.cols == camera.width && image.rows == camera.height) return;
  std::ostringstream text;
  text << side << " image is " << image.cols << " x " << image.rows
       << ", but its camera_info describes " << camera.width << " x " << camera.height
       << "; recalibrate for this resolution or set binning and roi in camera_info";
  throw MessageError(text.str());
}

[[noreturn]] void throwCalibrationError(const std::string& field, double value,
                                        const std::string& cure) {
  std::ostringstream text;
  text << field << " is " << value << ": " << cure;
  throw MessageError(text.str());
}

constexpr const char* kCalibrate =
    "calibrate the stereo pair (camera_calibration) and load the result into the camera driver";

void checkProjection(const std::string& side, const CameraCalibration& camera) {
  const std::string name = side + "/camera_info: ";
  if (camera.width <= 0 || camera.height <= 0) {
    throwCalibrationError(name + (camera.width <= 0 ? "width" : "height"),
                          camera.width <= 0 ? camera.width : camera.height,
                          "the driver must fill in the size of the calibrated image");
  }
  if (!camera.P.allFinite()) {
    throw MessageError(name + "P has an entry that is not a finite number: " + kCalibrate);
  }
  if (camera.P.isZero(0.0)) throw MessageError(name + "P is all zero: " + kCalibrate);
  if (camera.P(0, 0) <= 0.0) throwCalibrationError(name + "P[0] (fx)", camera.P(0, 0), kCalibrate);
  if (camera.P(1, 1) <= 0.0) throwCalibrationError(name + "P[5] (fy)", camera.P(1, 1), kCalibrate);
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
    throwCalibrationError("left/camera_info: P[3]", left_offset,
                          "it must be 0, left and right cameras are probably swapped; exchange "
                          "the topics");
  }
  if (right_offset == 0.0) {
    throwCalibrationError("right/camera_info: P[3] (-fx * baseline)", right_offset,
                          "the baseline must be positive, so this is not a stereo calibration or "
                          "both topics carry the left camera's info; check the remapping");
  }
  if (right_offset > 0.0) {
    throwCalibrationError("right/camera_info: P[3] (-fx * baseline)", right_offset,
                          "the baseline must be positive, left and right cameras are probably "
                          "swapped; exchange the topics");
  }
}

/// Moves and scales the first two rows of K or P to the transmitted part of the image, as
/// image_geometry does.
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

/// A field that is not used may hold NaN: the same NaN is no change.
template <typename Numbers>
bool sameNumbers(const Numbers& a, const Numbers& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](double x, double y) { return x == y || (std::isnan(x) && std::isnan(y)); });
}

Eigen::Isometry3d isometry(const Eigen::Vector3d& translation, const Eigen::Quaterniond& rotation) {
  constexpr double kNormTolerance = 0.01;
  if (!translation.allFinite() || !rotation.coeffs().allFinite()) {
    throw MessageError("pose: a number is not finite; send finite numbers");
  }
  if (std::abs(rotation.norm() - 1.0) > kNormTolerance) {
    throwCalibrationError("pose: length of the orientation quaternion", rotation.norm(),
                          "it must be 1; for no rotation send w: 1");
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = rotation.normalized().toRotationMatrix();
  T.translation() = translation;
  return T;
}

Eigen::Matrix3d crossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

}  // namespace

cv::Mat toGray(const sensor_msgs::Image& image) {
  const PixelFormat& format = pixelFormat(image.encoding);
  checkLayout(image, format);
  // cv::Mat has no read-only view; nothing below writes to it.
  auto* pixels = const_cast<std::uint8_t*>(image.data.data());
  cv::Mat shared(static_cast<int>(image.height), static_cast<int>(image.width), format.cv_type,
                 pixels, image.step);
  if (format.to_gray == kShared) return shared;
  cv::Mat gray;
  if (format.to_gray == kHighByte) {
    cv::extractChannel(shared, gray, image.is_bigendian ? 0 : 1);
  } else {
    cv::cvtColor(shared, gray, format.to_gray);
  }
  return gray;
}

StereoImages toStereoImages(const sensor_msgs::Image& left, const sensor_msgs::Image& right,
                            const StereoCalibration& calibration) {
  StereoImages images;
  images.left = toGray(left);
  images.right = toGray(right);
  images.stamp_ns = toNanoseconds(left.header.stamp);
  checkImageSize("left", images.left, calibration.left);
  checkImageSize("right", images.right, calibration.right);
  return images;
}

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

std::string withoutLeadingSlash(const std::string& frame_id) {
  return frame_id.substr(frame_id.find_first_not_of('/') == 1 ? 1 : 0);
}

std::int64_t toNanoseconds(const ros::Time& stamp) {
  return static_cast<std::int64_t>(stamp.toNSec());
}

geometry_msgs::Point toPoint(const Eigen::Vector3d& p) {
  geometry_msgs::Point point;
  point.x = p.x();
  point.y = p.y();
  point.z = p.z();
  return point;
}

geometry_msgs::Point32 toPoint32(const Eigen::Vector3f& p) {
  geometry_msgs::Point32 point;
  point.x = p.x();
  point.y = p.y();
  point.z = p.z();
  return point;
}

geometry_msgs::Quaternion toQuaternion(const Eigen::Quaterniond& q) {
  Eigen::Quaterniond unit = q.normalized();
  if (unit.w() < 0.0) unit.coeffs() = -unit.coeffs();
  geometry_msgs::Quaternion quaternion;
  quaternion.x = unit.x();
  quaternion.y = unit.y();
  quaternion.z = unit.z();
  quaternion.w = unit.w();
  return quaternion;
}

geometry_msgs::Pose toPose(const Eigen::Isometry3d& T) {
  geometry_msgs::Pose pose;
  pose.position = toPoint(T.translation());
  pose.orientation = toQuaternion(Eigen::Quaterniond(T.linear()));
  return pose;
}

geometry_msgs::Transform toTransform(const Eigen::Isometry3d& T) {
  geometry_msgs::Transform transform;
  transform.translation.x = T.translation().x();
  transform.translation.y = T.translation().y();
  transform.translation.z = T.translation().z();
  transform.rotation = toQuaternion(Eigen::Quaterniond(T.linear()));
  return transform;
}

Eigen::Isometry3d toIsometry(const geometry_msgs::Pose& pose) {
  const auto& p = pose.position;
  const auto& q = pose.orientation;
  return isometry({p.x, p.y, p.z}, {q.w, q.x, q.y, q.z});
}

Eigen::Isometry3d toIsometry(const geometry_msgs::Transform& transform) {
  const auto& t = transform.translation;
  const auto& q = transform.rotation;
  return isometry({t.x, t.y, t.z}, {q.w, q.x, q.y, q.z});
}

geometry_msgs::PoseWithCovariance::_covariance_type toCovariance(const Matrix6d& covariance) {
  geometry_msgs::PoseWithCovariance::_covariance_type values;
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(values.data()) = covariance;
  return values;
}

Matrix6d twistAdjoint(const Eigen::Isometry3d& T_a_b) {
  Matrix6d adjoint = Matrix6d::Zero();
  adjoint.topLeftCorner<3, 3>() = T_a_b.linear();
  adjoint.topRightCorner<3, 3>() = crossMatrix(T_a_b.translation()) * T_a_b.linear();
  adjoint.bottomRightCorner<3, 3>() = T_a_b.linear();
  return adjoint;
}

Matrix6d basePoseCovariance(const Matrix6d& camera_covariance,
                            const Eigen::Isometry3d& T_odom_camera,
                            const Eigen::Isometry3d& T_camera_base) {
  const Eigen::Vector3d camera_to_base = T_odom_camera.linear() * T_camera_base.translation();
  Matrix6d jacobian = Matrix6d::Identity();
  jacobian.topRightCorner<3, 3>() = -crossMatrix(camera_to_base);
  return jacobian * camera_covariance * jacobian.transpose();
}

}  // namespace point_line_odometry
