/// Images that show two cameras side by side, and calibrations in files.

#include "ros/side_by_side.h"

#include <gtest/gtest.h>

#include <string>

#include "dataset/camera_info_file.h"
#include "ros/calibration_conversion.h"
#include "ros/played_camera.h"

namespace point_line_odometry {
namespace {

/// Each byte is the column of its pixel, in rows with `padding` bytes behind them.
sensor_msgs::Image columns(const std::string& encoding, std::uint32_t bytes, std::uint32_t width,
                           std::uint32_t padding = 0) {
  sensor_msgs::Image image;
  image.header.stamp = ros::Time(12, 34);
  image.header.frame_id = "usb_cam";
  image.encoding = encoding;
  image.width = width;
  image.height = 3;
  image.step = width * bytes + padding;
  image.data.assign(static_cast<std::size_t>(image.step) * image.height, 255);
  for (std::uint32_t v = 0; v < image.height; ++v) {
    for (std::uint32_t i = 0; i < width * bytes; ++i)
      image.data[v * image.step + i] = static_cast<std::uint8_t>(i / bytes);
  }
  return image;
}

struct Layout {
  const char* encoding;
  std::uint32_t bytes;
};

TEST(SideBySideTest, BothHalvesHaveTheirPixelsAndTheHeader) {
  for (const Layout& layout : {Layout{"mono8", 1}, Layout{"mono16", 2}, Layout{"rgb8", 3},
                               Layout{"bgra8", 4}, Layout{"yuv422", 2}, Layout{"bayer_rggb8", 1}}) {
    for (const std::uint32_t padding : {0U, 5U}) {
      const auto halves = cutInTwo(columns(layout.encoding, layout.bytes, 8, padding));
      for (std::uint32_t i = 0; i < 2; ++i) {
        const sensor_msgs::Image& half = *halves[i];
        EXPECT_EQ(half.header.stamp, ros::Time(12, 34));
        EXPECT_EQ(half.header.frame_id, "usb_cam");
        EXPECT_EQ(half.encoding, layout.encoding);
        EXPECT_EQ(half.width, 4U);
        EXPECT_EQ(half.height, 3U);
        ASSERT_EQ(half.data.size(), 4U * layout.bytes * 3U) << layout.encoding;
        for (std::size_t k = 0; k < half.data.size(); ++k)
          EXPECT_EQ(half.data[k], 4 * i + k / layout.bytes % 4) << layout.encoding << ' ' << k;
      }
    }
  }
}

TEST(SideBySideTest, WhatCannotBeCutIsRefused) {
  EXPECT_NO_THROW(cutInTwo(columns("rgb8", 3, 6)));
  EXPECT_THROW(cutInTwo(columns("rgb8", 3, 7)), MessageError) << "odd width";
  EXPECT_THROW(cutInTwo(columns("rgb8", 3, 0)), MessageError);
  EXPECT_THROW(cutInTwo(columns("bayer_rggb8", 1, 6)), MessageError) << "the right half begins odd";
  EXPECT_THROW(cutInTwo(columns("yuv422", 2, 6)), MessageError);
  EXPECT_THROW(cutInTwo(columns("jpeg", 1, 6)), MessageError);
  sensor_msgs::Image image = columns("mono8", 1, 8);
  image.data.pop_back();
  EXPECT_THROW(cutInTwo(image), MessageError) << "too few bytes";
  image = columns("mono8", 1, 8);
  image.step = 4;
  EXPECT_THROW(cutInTwo(image), MessageError) << "rows too short";
  image = columns("mono8", 1, 8);
  image.height = 4000000000U;
  EXPECT_THROW(cutInTwo(image), MessageError) << "before memory is asked for";
}

TEST(SideBySideTest, CalibrationOfThePlayedCameraIsThatOfItsFiles) {
  const std::string folder = std::string(TEST_REPOSITORY_DIR) + "/config/cameras/stereo_usb_";
  const PlayedCamera played = playedCamera("stereo_usb").value();
  for (const bool left : {true, false}) {
    const sensor_msgs::CameraInfo read =
        toCameraInfo(readCameraInfo(folder + (left ? "left" : "right") + ".yaml"), {});
    const CameraCalibration& own = left ? played.calibration.left : played.calibration.right;
    const char* differs = differingField(read, toCameraInfo(own, {}));
    EXPECT_EQ(differs, nullptr) << differs;
  }
}

TEST(PlayedCameraTest, EachHasACalibrationThatCanBeUsed) {
  for (const std::string& name : playedCameraNames()) {
    const PlayedCamera played = playedCamera(name).value();
    EXPECT_NO_THROW(rectifiedCamera(played.calibration)) << name;
    if (played.raw) {
      EXPECT_NO_THROW(StereoRectifier{played.calibration}) << name;
    }
  }
  EXPECT_FALSE(playedCamera("webcam"));
}

}  // namespace
}  // namespace point_line_odometry
