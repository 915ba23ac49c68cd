#include "dataset/png_file.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <vector>

namespace point_line_odometry {
namespace {

constexpr std::uint64_t kMaxPixels = std::uint64_t{1} << 26;
/// Signature, then the length and the name of the first chunk, which is the header.
const std::string kBegin("\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR", 16);
constexpr std::size_t kWidthAt = 16;
constexpr std::size_t kHeightAt = 20;
constexpr std::size_t kSizesEnd = 24;

/// Empty if the file cannot be read.
std::vector<char> readBytes(const std::string& file) {
  std::error_code error;
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in || !std::filesystem::is_regular_file(file, error)) return {};
  std::vector<char> bytes(static_cast<std::size_t>(std::max<std::streamoff>(in.tellg(), 0)));
  in.seekg(0).read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return in ? bytes : std::vector<char>();
}

std::uint64_t bigEndian(const std::vector<char>& bytes, std::size_t at) {
  std::uint64_t value = 0;
  for (std::size_t i = at; i < at + 4; ++i)
    value = value << 8 | static_cast<std::uint8_t>(bytes[i]);
  return value;
}

bool isPossible(const std::vector<char>& bytes) {
  return bytes.size() >= kSizesEnd && std::equal(kBegin.begin(), kBegin.end(), bytes.begin()) &&
         bigEndian(bytes, kWidthAt) * bigEndian(bytes, kHeightAt) <= kMaxPixels;
}

/// A file that was cut off lacks its closing chunk; looked for here, as libpng complains on stderr.
bool isCutOff(const std::vector<char>& bytes) {
  const auto tail = std::min<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(bytes.size()), 64);
  return std::string(bytes.end() - tail, bytes.end()).find("IEND") == std::string::npos;
}

}  // namespace

cv::Mat readPng(const std::string& file, int flags) {
  const std::vector<char> bytes = readBytes(file);
  if (!isPossible(bytes) || isCutOff(bytes)) return {};
  try {
    return cv::imdecode(bytes, flags);
  } catch (const cv::Exception&) {
    return {};
  }
}

}  // namespace point_line_odometry
