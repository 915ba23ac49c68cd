// Stereo odometry over two folders of rectified images, without ROS. For each pair it prints a row
// "stamp x y z qx qy qz qw" [s, m]: the left camera in its first pose (x right, y down, z forward).
// CALIBRATION is a calib.txt as KITTI has it: projection matrices P0 (left) and P1, row-major.
#include <point_line_odometry/rectification.h>
#include <point_line_odometry/stereo_odometry.h>

#include <cstdint>
#include <exception>
#include <fstream>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

namespace plo = point_line_odometry;

cv::Mat readImage(const std::string& file) { return cv::imread(file, cv::IMREAD_GRAYSCALE); }

plo::StereoCamera readCamera(const std::string& file, const cv::Size& size) {
  plo::StereoCalibration calibration;
  std::ifstream in(file);
  std::string name;
  for (plo::CameraCalibration* camera : {&calibration.left, &calibration.right}) {
    camera->width = size.width;
    camera->height = size.height;
    in >> name;
    for (int i = 0; i < 12; ++i) in >> camera->P(i / 4, i % 4);
  }
  return plo::rectifiedCamera(calibration);  // throws if the numbers cannot be right
}

int main(int argc, char** argv) try {
  if (argc != 5) {
    std::cerr << "usage: minimal LEFT_FOLDER RIGHT_FOLDER CALIBRATION FRAMES_PER_SECOND\n";
    return 2;
  }
  std::vector<cv::String> left;
  std::vector<cv::String> right;
  cv::glob(std::string(argv[1]) + "/*.png", left);
  cv::glob(std::string(argv[2]) + "/*.png", right);
  if (left.empty() || left.size() != right.size())
    throw std::runtime_error("the folders must have as many PNG files, and one at least");
  const double period_ns = 1e9 / std::stod(argv[4]);
  if (!(period_ns > 0.0 && period_ns < 1e15))
    throw std::runtime_error("FRAMES_PER_SECOND must be more than 0");
  const plo::StereoCamera camera = readCamera(argv[3], readImage(left[0]).size());
  plo::StereoOdometry odometry(camera, plo::Parameters());
  std::cout.precision(9);
  for (std::size_t i = 0; i < left.size(); ++i) {
    const auto stamp_ns = static_cast<std::int64_t>(period_ns * static_cast<double>(i));
    const plo::FrameResult result =
        odometry.process({readImage(left[i]), readImage(right[i]), stamp_ns});
    if (!result.accepted()) throw std::runtime_error(left[i] + ": " + toString(result.reason));
    const Eigen::Quaterniond q(result.T_odom_camera.linear());
    std::cout << 1e-9 * static_cast<double>(stamp_ns) << ' '
              << result.T_odom_camera.translation().transpose() << ' ' << q.coeffs().transpose()
              << '\n';
  }
} catch (const std::exception& error) {
  std::cerr << "minimal: " << error.what() << '\n';
  return 1;
}
