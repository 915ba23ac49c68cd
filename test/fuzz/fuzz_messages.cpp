/// Messages as they come from the network.

#include <ros/serialization.h>

#include <algorithm>
#include <cstring>
#include <numeric>
#include <optional>
#include <vector>

#include "fuzz/fuzz_support.h"
#include "fuzz/fuzz_targets.h"
#include "ros/calibration_conversion.h"
#include "ros/conversions.h"
#include "ros/image_conversion.h"

namespace point_line_odometry {
namespace {

/// Larger images only make the fuzzer slow.
constexpr std::uint64_t kMaxPixelBytes = 1U << 20U;

/// Skips parts of a serialised message.
class WireReader {
 public:
  WireReader(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  /// False if the message is shorter.
  bool skip(std::uint64_t bytes) {
    if (bytes > size_ - at_) return false;
    at_ += static_cast<std::size_t>(bytes);
    return true;
  }

  /// Skips an array: its length and its items.
  bool skipItems(std::uint64_t item_bytes) {
    std::uint32_t count = 0;
    const std::size_t begin = at_;
    if (!skip(sizeof(count))) return false;
    std::memcpy(&count, data_ + begin, sizeof(count));
    return skip(count * item_bytes);
  }

 private:
  const std::uint8_t* data_;
  std::size_t size_;
  std::size_t at_ = 0;
};

constexpr std::uint64_t kStampAndSequence = 12;

/// True if all array lengths fit the message. ROS allocates an array before it checks the length of
/// the message; 4 GB of zeros for every other input would only make the fuzzer slow.
bool lengthsFit(const sensor_msgs::Image&, WireReader wire) {
  const bool header = wire.skip(kStampAndSequence) && wire.skipItems(1);
  return header && wire.skip(8) && wire.skipItems(1) && wire.skip(5) && wire.skipItems(1);
}

bool lengthsFit(const sensor_msgs::CameraInfo&, WireReader wire) {
  const bool header = wire.skip(kStampAndSequence) && wire.skipItems(1);
  return header && wire.skip(8) && wire.skipItems(1) && wire.skipItems(sizeof(double));
}

template <typename Message>
std::optional<Message> deserialize(const std::uint8_t* data, std::size_t size) {
  Message message;
  if (!lengthsFit(message, WireReader(data, size))) return std::nullopt;
  std::vector<std::uint8_t> bytes(data, data + size);
  ros::serialization::IStream stream(bytes.data(), static_cast<std::uint32_t>(size));
  try {
    ros::serialization::deserialize(stream, message);
  } catch (const ros::serialization::StreamOverrunException&) {
    return std::nullopt;
  }
  return message;
}

void convert(const sensor_msgs::Image& image) {
  cv::Mat gray;
  try {
    gray = toGray(image);
  } catch (const MessageError&) {
    return;
  }
  require(gray.type() == CV_8UC1, "toGray() gives 8 bit grey");
  require(gray.cols == static_cast<int>(image.width), "toGray() keeps the width");
  require(gray.rows == static_cast<int>(image.height), "toGray() keeps the height");
  std::uint64_t sum = 0;  // reads every pixel
  for (int row = 0; row < gray.rows; ++row) {
    sum = std::accumulate(gray.ptr(row), gray.ptr(row) + gray.cols, sum);
  }
  require(sum <= 255U * gray.total(), "a pixel is at most 255");
}

/// Larger rectification maps only make the fuzzer slow.
constexpr int kMaxRectifiedSide_px = 256;

void rectify(const StereoCalibration& calibration) {
  const cv::Size size(calibration.left.width, calibration.left.height);
  if (std::max(size.width, size.height) > kMaxRectifiedSide_px) return;
  std::optional<StereoRectifier> rectifier;
  try {
    rectifier.emplace(calibration);
  } catch (const std::invalid_argument&) {
    return;
  }
  const StereoImages rectified = rectifier->rectify(
      {cv::Mat(size, CV_8UC1, cv::Scalar(90)), cv::Mat(size, CV_8UC1, cv::Scalar(160)), 0});
  require(rectified.left.size() == size && rectified.right.size() == size,
          "rectify() keeps the size");
}

}  // namespace

void fuzzImage(const std::uint8_t* data, std::size_t size) {
  std::optional<sensor_msgs::Image> image = deserialize<sensor_msgs::Image>(data, size);
  if (!image) return;
  convert(*image);
  // Random data rarely has the right length, so the image is also tried with that.
  const std::uint64_t bytes = static_cast<std::uint64_t>(image->step) * image->height;
  if (bytes > kMaxPixelBytes) return;
  image->data.resize(static_cast<std::size_t>(bytes));
  image->data.shrink_to_fit();
  convert(*image);
}

void fuzzCameraInfo(const std::uint8_t* data, std::size_t size) {
  const auto left = deserialize<sensor_msgs::CameraInfo>(data, size);
  if (!left) return;
  const std::size_t used = ros::serialization::serializationLength(*left);
  const auto right = deserialize<sensor_msgs::CameraInfo>(data + used, size - used);
  if (!right) return;
  StereoCalibration calibration;
  try {
    calibration = toStereoCalibration(*left, *right);
  } catch (const MessageError&) {
    return;
  }
  const sensor_msgs::CameraInfo again = toCameraInfo(calibration.left, left->header);
  require(again.D.size() == left->D.size(), "toCameraInfo() keeps the distortion");
  try {
    rectifiedCamera(calibration).validate();
  } catch (const std::invalid_argument&) {
    return;
  }
  rectify(calibration);
}

}  // namespace point_line_odometry
