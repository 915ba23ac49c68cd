#include "dataset/mask_file.h"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "common/input_error.h"
#include "dataset/png_file.h"

namespace point_line_odometry {
namespace {

constexpr std::array<const char*, 2> kSides{"left", "right"};

cv::Mat readMask(const std::string& file, const char* side) {
  const std::string name = std::string(side) + " mask '" + file + "'";
  cv::Mat image = readPng(file, cv::IMREAD_UNCHANGED);
  if (image.empty()) {
    throw InputError(name +
                     " cannot be read as a PNG: name a PNG of the camera's size, 0 where "
                     "pixels are to be ignored");
  }
  if (image.depth() != CV_8U) {
    throw InputError(name + " has " + std::to_string(8 * image.elemSize1()) +
                     " bit per channel: save it with 8");
  }
  if (image.channels() == 1) return image;
  cv::Mat grey;
  cv::cvtColor(image, grey, image.channels() == 4 ? cv::COLOR_BGRA2GRAY : cv::COLOR_BGR2GRAY);
  return grey;
}

}  // namespace

cv::Mat combineMasks(const cv::Mat& a, const cv::Mat& b) {
  if (a.empty()) return b;
  if (b.empty()) return a;
  return cv::min(a, b);
}

StaticMasks::StaticMasks(const MaskFiles& files) : files_(files) {
  for (std::size_t i = 0; i < files.size(); ++i) {
    if (files[i] != kNoMask) masks_[i] = readMask(files[i], kSides[i]);
  }
}

std::string StaticMasks::sizeFault(const StereoCalibration& calibration) const {
  const std::array<const CameraCalibration*, 2> cameras{&calibration.left, &calibration.right};
  for (std::size_t i = 0; i < masks_.size(); ++i) {
    const cv::Mat& mask = masks_[i];
    if (mask.empty() || (mask.cols == cameras[i]->width && mask.rows == cameras[i]->height))
      continue;
    const auto size = [](int width, int height) {
      return std::to_string(width) + " x " + std::to_string(height);
    };
    return std::string(kSides[i]) + " mask '" + files_[i] + "' is " + size(mask.cols, mask.rows) +
           ", but the camera's images are " + size(cameras[i]->width, cameras[i]->height) +
           ": make it of an image as the camera publishes it";
  }
  return {};
}

void StaticMasks::addTo(StereoImages* images) const {
  images->left_mask = combineMasks(images->left_mask, masks_[0]);
  images->right_mask = combineMasks(images->right_mask, masks_[1]);
}

}  // namespace point_line_odometry
