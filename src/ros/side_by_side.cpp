#include "ros/side_by_side.h"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace point_line_odometry {
namespace {

namespace encodings = sensor_msgs::image_encodings;

/// Bytes of a pixel; of yuv422, in which two pixels share colour, half of those of two.
std::uint32_t bytesPerPixel(const std::string& encoding) {
  if (encoding == "yuv422_yuy2") return 2;
  try {
    return static_cast<std::uint32_t>(encodings::numChannels(encoding) *
                                      encodings::bitDepth(encoding) / 8);
  } catch (const std::runtime_error&) {
    throw MessageError("image: encoding '" + encoding + "' is not known: it cannot be cut in two");
  }
}

bool sharesPixels(const std::string& encoding) {
  return encodings::isBayer(encoding) || encoding.rfind("yuv422", 0) == 0;
}

}  // namespace

std::array<sensor_msgs::ImagePtr, 2> cutInTwo(const sensor_msgs::Image& image) {
  const std::uint32_t bytes = bytesPerPixel(image.encoding);
  const std::uint32_t divisor = sharesPixels(image.encoding) ? 4 : 2;
  const std::string size = std::to_string(image.width) + " x " + std::to_string(image.height);
  if (image.width == 0 || image.height == 0 || image.width % divisor != 0) {
    throw MessageError(
        "image: " + size + " pixels of " + image.encoding +
        " cannot be cut in two halves of one size: the width must be a multiple of " +
        std::to_string(divisor));
  }
  const std::uint64_t needed = static_cast<std::uint64_t>(image.step) * image.height;
  if (image.step < static_cast<std::uint64_t>(image.width) * bytes || image.data.size() < needed) {
    throw MessageError("image: " + std::to_string(image.data.size()) + " bytes in rows of " +
                       std::to_string(image.step) + " are too few for " + size + " pixels of " +
                       image.encoding);
  }
  const std::uint32_t half = image.width / 2 * bytes;
  std::array<sensor_msgs::ImagePtr, 2> halves;
  for (std::uint32_t i = 0; i < 2; ++i) {
    const auto cut = boost::make_shared<sensor_msgs::Image>();
    cut->header = image.header;
    cut->width = image.width / 2;
    cut->height = image.height;
    cut->encoding = image.encoding;
    cut->is_bigendian = image.is_bigendian;
    cut->step = half;
    cut->data.resize(static_cast<std::size_t>(half) * image.height);
    for (std::uint32_t v = 0; v < image.height; ++v) {
      const auto row = image.data.begin() + static_cast<std::int64_t>(v) * image.step + i * half;
      std::copy(row, row + half, cut->data.begin() + static_cast<std::int64_t>(v) * half);
    }
    halves[i] = cut;
  }
  return halves;
}

}  // namespace point_line_odometry
