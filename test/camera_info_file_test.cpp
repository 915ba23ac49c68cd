#include "dataset/camera_info_file.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <string>

#include "common/input_error.h"

namespace point_line_odometry {
namespace {

/// A file that is removed in the end.
class CameraInfoFile : public ::testing::Test {
 protected:
  ~CameraInfoFile() override { std::remove(file_.c_str()); }

  CameraCalibration read(const std::string& text) const {
    std::ofstream(file_) << text;
    return readCameraInfo(file_);
  }

  void expectRefused(const std::string& text, const std::string& words) const {
    try {
      read(text);
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find(file_), std::string::npos) << error.what();
      return;
    }
    ADD_FAILURE() << "nothing was thrown; expected: " << words;
  }

  const std::string file_ =
      ::testing::TempDir() + "camera_info_" + std::to_string(getpid()) + ".yaml";
};

/// As camera_calibration writes it.
const std::string kWritten = R"(image_width: 640
image_height: 480
camera_name: narrow_stereo/left
camera_matrix:
  rows: 3
  cols: 3
  data: [430.15, 0, 311.1, 0, 430.5, 235.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.33, 0.1, 0.0005, -1e-05, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 0.8, -0.6, 0, 0.6, 0.8]
projection_matrix:
  rows: 3
  cols: 4
  data: [400, 0, 320, -40, 0, 400, 240, 0, 0, 0, 1, 0]
)";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

TEST_F(CameraInfoFile, ReadsTheFormatOfCameraCalibration) {
  const CameraCalibration camera = read(kWritten);
  EXPECT_EQ(camera.width, 640);
  EXPECT_EQ(camera.height, 480);
  EXPECT_EQ(camera.distortion_model, "plumb_bob");
  EXPECT_EQ(camera.D, (std::vector<double>{-0.33, 0.1, 0.0005, -1e-05, 0.0}));
  EXPECT_EQ(camera.K(0, 2), 311.1);
  EXPECT_EQ(camera.R(1, 2), -0.6);
  EXPECT_EQ(camera.P(0, 3), -40.0);
  EXPECT_EQ(camera.P(2, 2), 1.0);
}

TEST_F(CameraInfoFile, KeepsEveryBit) {
  CameraCalibration camera = read(kWritten);
  camera.K(0, 0) = 1.0 / 3.0 * 1e3;
  camera.R(0, 1) = -1e-17 / 3.0;
  camera.distortion_model = "equidistant";
  camera.D = {1e-05, -0.1, 1e300, 0.0};
  const std::string text = formatCameraInfo(camera, "right");
  EXPECT_NE(text.find("camera_name: right\n"), std::string::npos);
  EXPECT_NE(text.find("[1.0000000000000001e-05, "), std::string::npos) << text;
  const CameraCalibration again = read(text);
  EXPECT_EQ(again.K, camera.K);
  EXPECT_EQ(again.R, camera.R);
  EXPECT_EQ(again.P, camera.P);
  EXPECT_EQ(again.D, camera.D);
  EXPECT_EQ(again.distortion_model, "equidistant");
  EXPECT_EQ(again.width, camera.width);
  EXPECT_EQ(again.height, camera.height);
}

TEST_F(CameraInfoFile, NumbersWithExponentHaveAPointForPythonsYaml) {
  CameraCalibration camera = read(kWritten);
  camera.D = {1e22, -2e-05};
  EXPECT_NE(formatCameraInfo(camera, "left").find("[1.0e+22, -2.0000000000000002e-05]"),
            std::string::npos);
}

TEST_F(CameraInfoFile, RefusesWhatIsNoCalibration) {
  expectRefused("", "empty or no map");
  expectRefused("a: [1", "no yaml");
  expectRefused(replaced(kWritten, "image_width: 640", "image_width: 0"), "image_width");
  expectRefused(replaced(kWritten, "image_height: 480", "image_height: many"), "no yaml");
  expectRefused(replaced(kWritten, "camera_matrix", "matrix"), "camera_matrix has no list");
  expectRefused(replaced(kWritten, "430.15, 0", "430.15"), "camera_matrix has 8 numbers");
  expectRefused(replaced(kWritten, "[400, 0", "[.nan, 0"), "projection_matrix has a number that");
  expectRefused(replaced(kWritten, "-0.33", "x"), "no yaml");
  std::remove(file_.c_str());
  EXPECT_THROW(readCameraInfo(file_), InputError);
}

}  // namespace
}  // namespace point_line_odometry
