#include "ros/image_conversion.h"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <string>

namespace point_line_odometry {
namespace {

namespace encodings = sensor_msgs::image_encodings;

/// Memory layout of an encoding and its conversion to grey.
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

/// Throws unless the size of the pixel buffer is exactly that of the header fields.
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

cv::Mat toMask(const sensor_msgs::Image& mask, const CameraCalibration& camera) {
  if (mask.encoding != "mono8" && mask.encoding != "8UC1") {
    throw MessageError("mask: encoding is '" + mask.encoding + "', but must be mono8");
  }
  const cv::Mat image = toGray(mask);
  if (image.cols != camera.width || image.rows != camera.height) {
    std::ostringstream text;
    text << "mask: it is " << image.cols << " x " << image.rows << ", but the camera's images are "
         << camera.width << " x " << camera.height;
    throw MessageError(text.str());
  }
  return image.clone();
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

}  // namespace point_line_odometry
