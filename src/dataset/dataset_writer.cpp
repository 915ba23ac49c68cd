#include "dataset/dataset_writer.h"

#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <locale>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "common/classic_stream.h"
#include "common/input_error.h"

namespace point_line_odometry {
namespace {

namespace fs = std::filesystem;

/// The shortest text that is read back as the same number.
std::string exactText(double value) {
  constexpr int kAllDigits = 17;
  for (int digits = 6;; ++digits) {
    std::ostringstream text = classicStream();
    text << std::setprecision(digits) << value;
    std::istringstream in(text.str());
    in.imbue(std::locale::classic());
    double same = 0.0;
    in >> same;
    if (digits == kAllDigits || same == value) return text.str();
  }
}

template <typename Numbers>
std::string joinNumbers(const Numbers& numbers, const char* separator) {
  std::string text;
  for (const double number : numbers) text += (text.empty() ? "" : separator) + exactText(number);
  return text;
}

template <typename Matrix>
std::string joinMatrix(const Matrix& matrix, const char* separator) {
  std::vector<double> numbers;
  for (int row = 0; row < matrix.rows(); ++row) {
    for (int column = 0; column < matrix.cols(); ++column) numbers.push_back(matrix(row, column));
  }
  return joinNumbers(numbers, separator);
}

[[noreturn]] void refuse(const std::string& file) {
  throw InputError("'" + file + "' cannot be written: make room on disk, or give another folder");
}

/// EuRoC's stamps and image names: of the same length, so that they sort by time.
std::string eurocStamp(std::int64_t stamp_ns) {
  std::ostringstream text = classicStream();
  text << std::setw(19) << std::setfill('0') << stamp_ns;
  return text.str();
}

std::string eurocTransform(const Eigen::Isometry3d& T_body_sensor) {
  return "T_BS:\n  cols: 4\n  rows: 4\n  data: [" + joinMatrix(T_body_sensor.matrix(), ", ") +
         "]\n";
}

/// Distortion coefficients of EuRoC's files: four, or five if the last one is not 0.
std::vector<double> eurocDistortion(const CameraCalibration& camera) {
  std::vector<double> D = camera.D;
  if (D.size() == 5 && D.back() == 0.0) D.pop_back();
  return D;
}

std::string eurocCamera(const CameraCalibration& camera, const Eigen::Isometry3d& T_body_camera,
                        double frame_rate_hz) {
  const Eigen::Matrix3d& K = camera.K;
  const bool fisheye = camera.distortion_model == "equidistant";
  std::ostringstream text = classicStream();
  text << "sensor_type: camera\ncomment: synthetic\n"
       << eurocTransform(T_body_camera) << "rate_hz: " << exactText(frame_rate_hz)
       << "\nresolution: [" << camera.width << ", " << camera.height << "]\ncamera_model: pinhole\n"
       << "intrinsics: ["
       << joinNumbers(std::array<double, 4>{K(0, 0), K(1, 1), K(0, 2), K(1, 2)}, ", ")
       << "]\ndistortion_model: " << (fisheye ? "equidistant" : "radial-tangential")
       << "\ndistortion_coefficients: [" << joinNumbers(eurocDistortion(camera), ", ") << "]\n";
  return text.str();
}

std::string eurocGroundTruth(const std::vector<StampedPose>& poses) {
  std::ostringstream text = classicStream();
  text << "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], "
          "q_RS_y [], q_RS_z []\n"
       << std::fixed << std::setprecision(9);
  for (const StampedPose& pose : poses) {
    const Eigen::Vector3d& p = pose.T_world_camera.translation();
    const Eigen::Quaterniond q(pose.T_world_camera.linear());
    text << eurocStamp(pose.stamp_ns);
    for (const double value : {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()}) {
      text << ',' << value;
    }
    text << '\n';
  }
  return text.str();
}

std::string eurocImu(const std::vector<ImuSample>& samples) {
  std::string text =
      "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
      "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n";
  for (const ImuSample& sample : samples) {
    if (sample.stamp_ns < 0) continue;  // before the epoch: EuRoC's stamps have no sign
    text += eurocStamp(sample.stamp_ns) + "," + joinMatrix(sample.angular_velocity, ",") + "," +
            joinMatrix(sample.acceleration, ",") + "\n";
  }
  return text;
}

}  // namespace

DatasetWriter::DatasetWriter(const std::string& folder, DatasetLayout layout,
                             const StereoCalibration& calibration, double frame_rate_hz)
    : folder_(folder), layout_(layout), calibration_(calibration), frame_rate_hz_(frame_rate_hz) {
  std::error_code error;
  for (const int side : {0, 1}) {
    const fs::path images = fs::path(imageFile(side, 0)).parent_path();
    fs::create_directories(images, error);
    if (error) refuse(images.string());
  }
}

void DatasetWriter::writeImage(const std::string& file, const cv::Mat& image) const {
  constexpr int kFastCompression = 1;
  if (!cv::imwrite(file, image, {cv::IMWRITE_PNG_COMPRESSION, kFastCompression})) refuse(file);
}

void DatasetWriter::add(const StereoImages& images, const Eigen::Isometry3d& T_world_camera) {
  writeImage(imageFile(0, images.stamp_ns), images.left);
  writeImage(imageFile(1, images.stamp_ns), images.right);
  const auto writeMask = [&](const char* name, const cv::Mat& mask) {
    if (poses_.empty() && !mask.empty()) writeImage((fs::path(folder_) / name).string(), mask);
  };
  writeMask("mask_left.png", images.left_mask);
  writeMask("mask_right.png", images.right_mask);
  poses_.push_back({images.stamp_ns, T_world_camera});
}

void DatasetWriter::writeImu(const ImuData& imu) const {
  if (layout_ == DatasetLayout::kKitti) return;
  writeText("mav0/imu0/sensor.yaml",
            "sensor_type: imu\ncomment: synthetic\n" + eurocTransform(imu.T_imu_camera.inverse()));
  writeText("mav0/imu0/data.csv", eurocImu(imu.samples));
}

void DatasetWriter::finish() const {
  if (layout_ == DatasetLayout::kKitti) {
    finishKitti();
  } else {
    finishEuroc();
  }
}

/// P2 and P3, KITTI's colour cameras, repeat P0 and P1 for readers that need all four.
void DatasetWriter::finishKitti() const {
  std::string calibration;
  for (const int camera : {0, 1, 2, 3}) {
    const auto& P = camera % 2 == 0 ? calibration_.left.P : calibration_.right.P;
    calibration += "P" + std::to_string(camera) + ": " + joinMatrix(P, " ") + "\n";
  }
  std::ostringstream times = classicStream();
  std::ostringstream poses;
  writeKitti(poses, poses_);
  for (const StampedPose& pose : poses_) {
    writeStamp(times, pose.stamp_ns);
    times << '\n';
  }
  writeText("calib.txt", calibration);
  writeText("times.txt", times.str());
  writeText("poses.txt", poses.str());
}

void DatasetWriter::finishEuroc() const {
  const Eigen::Isometry3d identity = Eigen::Isometry3d::Identity();
  std::string index = "#timestamp [ns],filename\n";
  for (const StampedPose& pose : poses_) {
    const std::string stamp = eurocStamp(pose.stamp_ns);
    index += stamp + "," + stamp + ".png\n";
  }
  writeText("mav0/body.yaml", "comment: synthetic; the body is the left camera\n");
  for (const int side : {0, 1}) {
    const std::string camera = "mav0/cam" + std::to_string(side);
    writeText(camera + "/data.csv", index);
    writeText(camera + "/sensor.yaml",
              eurocCamera(side == 0 ? calibration_.left : calibration_.right,
                          side == 0 ? identity : poseOfRightInLeft(calibration_), frame_rate_hz_));
  }
  const std::string ground_truth = "mav0/state_groundtruth_estimate0";
  writeText(
      ground_truth + "/sensor.yaml",
      "sensor_type: visual-inertial\ncomment: exact ground truth\n" + eurocTransform(identity));
  writeText(ground_truth + "/data.csv", eurocGroundTruth(poses_));
}

std::string DatasetWriter::imageFile(int side, std::int64_t stamp_ns) const {
  const fs::path folder(folder_);
  if (layout_ == DatasetLayout::kEuroc) {
    const fs::path camera = folder / "mav0" / ("cam" + std::to_string(side));
    return (camera / "data" / (eurocStamp(stamp_ns) + ".png")).string();
  }
  std::ostringstream name = classicStream();
  name << std::setw(6) << std::setfill('0') << poses_.size() << ".png";
  return (folder / ("image_" + std::to_string(side)) / name.str()).string();
}

void DatasetWriter::writeText(const std::string& name, const std::string& text) const {
  const fs::path file = fs::path(folder_) / name;
  std::error_code error;
  fs::create_directories(file.parent_path(), error);
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.close();
  if (!out) refuse(file.string());
}

}  // namespace point_line_odometry
