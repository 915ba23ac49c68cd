#include "dataset/dataset.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <locale>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <sstream>

#include "dataset/oxts.h"
#include "dataset/png_file.h"
#include "dataset/text_rows.h"

namespace point_line_odometry {
namespace {

namespace fs = std::filesystem;

constexpr double kNanosecondsPerSecond = 1e9;
constexpr std::uint64_t kMaxStamp_ns = 4000000000000000000U;  // limit of ros::Time

/// The leading field of a row; throws beyond the limit of ros::Time.
std::int64_t parseStamp_ns(const std::string& row, const fs::path& file) {
  const std::string field = row.substr(0, row.find_first_of(", \t"));
  const bool digits =
      std::all_of(field.begin(), field.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
  if (field.empty() || !digits || field.size() > 19 || std::stoull(field) > kMaxStamp_ns) {
    fail("file ", inQuotes(file), " has a row without a stamp in nanoseconds: '", row, "'");
  }
  return std::stoll(field);
}

cv::Mat readImage(const fs::path& file) {
  if (!isFile(file)) {
    fail("image ", inQuotes(file), " is missing or unreadable: unpack the data set again");
  }
  cv::Mat image = readPng(file.string(), cv::IMREAD_GRAYSCALE);
  if (!image.empty()) return image;
  fail("image ", inQuotes(file),
       " cannot be decoded: it is damaged, cut off or no PNG, fetch it again");
}

void requireSize(const cv::Mat& image, const std::string& file, const CameraCalibration& camera) {
  if (image.cols == camera.width && image.rows == camera.height) return;
  fail("image '", file, "' is ", image.cols, " x ", image.rows, ", but the calibration is for ",
       camera.width, " x ", camera.height, ": fetch images and calibration of one sequence");
}

/// Throws if a file of the index is missing.
void requireFiles(const std::vector<StereoDataset::Frame>& frames, const fs::path& folder) {
  std::size_t missing = 0;
  std::string first;
  for (const StereoDataset::Frame& frame : frames) {
    for (const std::string& file : {frame.left_file, frame.right_file}) {
      if (isFile(file)) continue;
      if (missing++ == 0) first = file;
    }
  }
  if (missing == 0) return;
  fail("data set ", inQuotes(folder), " is truncated: ", missing, " of ", 2 * frames.size(),
       " images are missing, the first is '", first, "'; unpack it again");
}

bool isRotation(const Eigen::Matrix3d& R) {
  return (R * R.transpose()).isIdentity(1e-3) && R.determinant() > 0.0;
}

/// Runs a step on the calibration, and adds the name of the file to its errors.
template <typename Step>
auto withCalibrationFile(const fs::path& file, const Step& step) {
  try {
    return step();
  } catch (const std::invalid_argument& error) {
    throw InputError("calibration " + inQuotes(file) + " is unusable: " + error.what());
  } catch (const YAML::Exception& error) {
    throw InputError("calibration " + inQuotes(file) + " is unusable: " + error.what() +
                     "; fetch the file again");
  }
}

// --- KITTI ------------------------------------------------------------------------------------

/// Otherwise the order of the names is not that of their numbers.
void requireEqualLengths(const fs::path& folder, const std::vector<std::string>& names) {
  for (const std::string& name : names) {
    if (name.size() == names.front().size()) continue;
    fail("images in ", inQuotes(folder), " are numbered with different numbers of digits, as '",
         names.front(), "' and '", name, "': add zeros in front, as in 000000.png");
  }
}

std::vector<std::string> listImages(const fs::path& folder) {
  if (!fs::is_directory(folder)) {
    fail("folder ", inQuotes(folder), " is missing: a KITTI sequence needs image_0 and image_1");
  }
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    const bool hidden = name.front() == '.';  // as macOS adds to each file on other systems' disks
    if (entry.path().extension() == ".png" && entry.is_regular_file() && !hidden)
      names.push_back(name);
  }
  std::sort(names.begin(), names.end());
  requireEqualLengths(folder, names);
  return names;
}

/// Nothing if a row is not one number. A double has not the digits of nanoseconds since 1970.
std::optional<long double> parseSeconds(const std::string& row) {
  std::istringstream text(row);
  text.imbue(std::locale::classic());
  long double seconds = 0.0L;
  std::string rest;
  if (!(text >> seconds) || text >> rest) return std::nullopt;
  return seconds;
}

std::vector<std::int64_t> readKittiStamps(const fs::path& file) {
  std::vector<std::int64_t> stamps;
  for (const std::string& row : readLines(file)) {
    const std::optional<long double> seconds = parseSeconds(row);
    if (!seconds || !(*seconds >= 0.0L) ||
        *seconds * kNanosecondsPerSecond > static_cast<long double>(kMaxStamp_ns)) {
      fail("file ", inQuotes(file), " has the row '", row, "', but must hold seconds, one a row");
    }
    stamps.push_back(std::llround(*seconds * kNanosecondsPerSecond));
  }
  return stamps;
}

std::vector<StereoDataset::Frame> indexKitti(const fs::path& folder) {
  const std::vector<std::string> left = listImages(folder / "image_0");
  const std::vector<std::string> right = listImages(folder / "image_1");
  const std::vector<std::int64_t> stamps = readKittiStamps(folder / "times.txt");
  if (left.empty() && right.empty()) {
    fail("data set ", inQuotes(folder), " is empty: image_0 and image_1 hold no PNG image");
  }
  if (left.size() != right.size() || left.size() != stamps.size()) {
    fail("data set ", inQuotes(folder), " is truncated: image_0 has ", left.size(),
         " images, image_1 ", right.size(), " and times.txt ", stamps.size(),
         " rows; unpack it again");
  }
  std::vector<StereoDataset::Frame> frames(left.size());
  for (std::size_t i = 0; i < frames.size(); ++i) {
    frames[i] = {stamps[i], (folder / "image_0" / left[i]).string(),
                 (folder / "image_1" / left[i]).string()};
  }
  requireFiles(frames, folder);
  return frames;
}

/// The 3 x 4 matrix of a KITTI row.
Eigen::Matrix<double, 3, 4> toMatrix34(const std::vector<double>& numbers, const fs::path& file) {
  if (numbers.size() != 12) {
    fail("file ", inQuotes(file), " has a row of ", numbers.size(),
         " numbers instead of 12: it is truncated or of another kind; fetch it again");
  }
  return Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(numbers.data());
}

CameraCalibration readKittiCamera(const fs::path& file, const std::string& name) {
  for (const std::string& row : readLines(file)) {
    if (row.rfind(name + ":", 0) != 0) continue;
    CameraCalibration camera;
    camera.P = toMatrix34(parseNumbers(row.substr(name.size() + 1), file), file);
    camera.K = camera.P.leftCols<3>();
    camera.D.assign(5, 0.0);
    return camera;
  }
  fail("calibration ", inQuotes(file), " has no row '", name, ":': P0 and P1 are needed");
}

StereoCalibration readKittiCalibration(const fs::path& file, const cv::Size& size) {
  StereoCalibration calibration{readKittiCamera(file, "P0"), readKittiCamera(file, "P1")};
  for (CameraCalibration* camera : {&calibration.left, &calibration.right}) {
    camera->width = size.width;
    camera->height = size.height;
  }
  withCalibrationFile(file, [&] { return rectifiedCamera(calibration); });
  return calibration;
}

/// Ground truth of the sequence: in the folder, or at its path in the published data set.
std::vector<StampedPose> readKittiPoses(const fs::path& folder,
                                        const std::vector<StereoDataset::Frame>& frames) {
  fs::path file = folder / "poses.txt";
  if (!fs::exists(file)) {
    const fs::path sequence = fs::canonical(folder);
    file = sequence.parent_path().parent_path() / "poses" / (sequence.filename().string() + ".txt");
  }
  if (!fs::exists(file)) return {};
  const std::vector<std::string> rows = readLines(file);
  if (rows.size() != frames.size()) {
    fail("ground truth ", inQuotes(file), " has ", rows.size(), " rows for ", frames.size(),
         " images: fetch the poses of this sequence or remove the file");
  }
  std::vector<StampedPose> poses;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    StampedPose pose{frames[i].stamp_ns, Eigen::Isometry3d::Identity()};
    pose.T_world_camera.affine() = toMatrix34(parseNumbers(rows[i], file), file);
    if (!isRotation(pose.T_world_camera.linear())) {
      fail("ground truth ", inQuotes(file), " is no pose in row ", i + 1,
           ": the first three of each four numbers must be a rotation");
    }
    poses.push_back(pose);
  }
  return poses;
}

// --- EuRoC ------------------------------------------------------------------------------------

/// Content of a camera's sensor.yaml.
struct EurocCamera {
  CameraCalibration calibration;
  Eigen::Isometry3d T_body_camera = Eigen::Isometry3d::Identity();
};

template <typename T>
std::vector<T> readYaml(const YAML::Node& node, const char* name, std::size_t count) {
  auto numbers = node && node.IsSequence() ? node.as<std::vector<T>>() : std::vector<T>();
  if (numbers.size() == count) return numbers;
  std::ostringstream text;
  text << name << " has " << numbers.size() << " numbers, but must have " << count;
  throw std::invalid_argument(text.str());
}

/// The name in sensor_msgs/CameraInfo of one of EuRoC's distortion models.
std::string toDistortionModel(const std::string& name, std::size_t coefficients) {
  if (name == "equidistant") return "equidistant";
  if (name == "radial-tangential" || name == "radtan" || name == "plumb_bob") {
    return coefficients > 5 ? "rational_polynomial" : "plumb_bob";
  }
  throw std::invalid_argument("distortion_model '" + name +
                              "' is unknown: use radial-tangential or equidistant");
}

Eigen::Isometry3d toPose(const std::vector<double>& numbers) {
  Eigen::Isometry3d pose;
  pose.matrix() = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(numbers.data());
  if (!isRotation(pose.linear())) {
    throw std::invalid_argument(
        "T_BS is not a pose: its upper left 3 x 3 block must be a rotation");
  }
  return pose;
}

EurocCamera readEurocCamera(const fs::path& file) {
  if (!fs::exists(file)) {
    fail("calibration ", inQuotes(file), " is missing: unpack the data set again");
  }
  return withCalibrationFile(file, [&] {
    const YAML::Node root = YAML::LoadFile(file.string());
    if (!root.IsMap()) throw std::invalid_argument("it is empty or not YAML; fetch it again");
    EurocCamera camera;
    CameraCalibration& calibration = camera.calibration;
    const std::vector<int> size = readYaml<int>(root["resolution"], "resolution", 2);
    calibration.width = size[0];
    calibration.height = size[1];
    const std::vector<double> f = readYaml<double>(root["intrinsics"], "intrinsics", 4);
    calibration.K << f[0], 0.0, f[2], 0.0, f[1], f[3], 0.0, 0.0, 1.0;
    calibration.D = root["distortion_coefficients"].as<std::vector<double>>();
    calibration.distortion_model =
        toDistortionModel(root["distortion_model"].as<std::string>(), calibration.D.size());
    if (calibration.distortion_model == "plumb_bob") calibration.D.resize(5, 0.0);
    camera.T_body_camera = toPose(readYaml<double>(root["T_BS"]["data"], "T_BS", 16));
    return camera;
  });
}

/// Image files of a camera's data.csv by stamp.
std::map<std::int64_t, std::string> indexEurocCamera(const fs::path& folder) {
  const fs::path file = folder / "data.csv";
  std::map<std::int64_t, std::string> images;
  for (const std::string& row : readTable(file)) {
    const std::size_t name = row.find_first_not_of(", ", row.find(','));
    if (name == std::string::npos) {
      fail("file ", inQuotes(file), " has the row '", row, "', but must hold 'stamp,filename'");
    }
    images[parseStamp_ns(row, file)] = (folder / "data" / row.substr(name)).string();
  }
  if (images.empty()) fail("file ", inQuotes(file), " names no image: the data set is empty");
  return images;
}

std::vector<StereoDataset::Frame> indexEuroc(const fs::path& folder) {
  const std::map<std::int64_t, std::string> left = indexEurocCamera(folder / "cam0");
  const std::map<std::int64_t, std::string> right = indexEurocCamera(folder / "cam1");
  std::vector<StereoDataset::Frame> frames;
  for (const auto& [stamp_ns, left_file] : left) {
    const auto partner = right.find(stamp_ns);
    if (partner != right.end()) frames.push_back({stamp_ns, left_file, partner->second});
  }
  if (frames.empty()) {
    fail("data set ", inQuotes(folder), " has no pair: no stamp of cam0/data.csv occurs in ",
         "cam1/data.csv; give images of synchronised cameras equal stamps");
  }
  requireFiles(frames, folder);
  return frames;
}

/// T_BS of the IMU; the identity, as in the published data, without a file.
Eigen::Isometry3d readEurocImuPose(const fs::path& file) {
  if (!fs::exists(file)) return Eigen::Isometry3d::Identity();
  return withCalibrationFile(file, [&] {
    const YAML::Node root = YAML::LoadFile(file.string());
    if (!root.IsMap()) throw std::invalid_argument("it is empty or not YAML; fetch it again");
    return toPose(readYaml<double>(root["T_BS"]["data"], "T_BS", 16));
  });
}

std::vector<StampedPose> readEurocPoses(const fs::path& file,
                                        const Eigen::Isometry3d& T_body_camera) {
  std::vector<StampedPose> poses;
  if (!fs::exists(file)) return poses;
  for (const std::string& row : readTable(file)) {
    const std::vector<double> n = parseNumbers(row, file);
    const double norm = n.size() < 8 ? 0.0 : Eigen::Vector4d(n[4], n[5], n[6], n[7]).norm();
    if (std::abs(norm - 1.0) > 0.01) {
      fail("ground truth ", inQuotes(file), " has a row without a position and unit quaternion: '",
           row, "'; fetch the file again");
    }
    Eigen::Isometry3d T_world_body = Eigen::Isometry3d::Identity();
    T_world_body.linear() =
        Eigen::Quaterniond(n[4], n[5], n[6], n[7]).normalized().toRotationMatrix();
    T_world_body.translation() << n[1], n[2], n[3];
    poses.push_back({parseStamp_ns(row, file), T_world_body * T_body_camera});
  }
  return poses;
}

}  // namespace

StereoDataset StereoDataset::openKitti(const std::string& folder) {
  StereoDataset dataset;
  dataset.frames_ = indexKitti(folder);
  const cv::Size size = readImage(dataset.frames_.front().left_file).size();
  dataset.calibration_ = readKittiCalibration(fs::path(folder) / "calib.txt", size);
  dataset.ground_truth_ = readKittiPoses(folder, dataset.frames_);
  if (fs::is_directory(fs::path(folder) / "oxts")) dataset.oxts_folder_ = folder;
  return dataset;
}

StereoDataset StereoDataset::openEuroc(const std::string& folder) {
  const fs::path path(folder);
  StereoDataset dataset;
  dataset.frames_ = indexEuroc(path);
  const EurocCamera left = readEurocCamera(path / "cam0" / "sensor.yaml");
  const EurocCamera right = readEurocCamera(path / "cam1" / "sensor.yaml");
  dataset.calibration_ = withCalibrationFile(path / "cam[01]" / "sensor.yaml", [&] {
    StereoCalibration rectified = rectifyCalibration(
        {left.calibration, right.calibration}, right.T_body_camera.inverse() * left.T_body_camera);
    rectifiedCamera(rectified);
    return rectified;
  });
  dataset.needs_rectification_ = true;
  dataset.T_body_camera_ = left.T_body_camera;
  if (isFile(path / "imu0" / "data.csv")) dataset.imu_folder_ = (path / "imu0").string();
  dataset.ground_truth_ =
      readEurocPoses(path / "state_groundtruth_estimate0" / "data.csv", left.T_body_camera);
  return dataset;
}

std::optional<ImuData> StereoDataset::readImu() const {
  if (!oxts_folder_.empty()) return readOxts(oxts_folder_, frames_.front().stamp_ns);
  if (imu_folder_.empty() || !T_body_camera_) return std::nullopt;
  const fs::path folder(imu_folder_);
  const Eigen::Isometry3d T_body_imu = readEurocImuPose(folder / "sensor.yaml");
  ImuData data;
  data.T_imu_camera = T_body_imu.inverse() * *T_body_camera_;
  const fs::path file = folder / "data.csv";
  for (const std::string& row : readTable(file)) {
    const std::vector<double> n = parseNumbers(row, file);
    if (n.size() != 7) {
      fail("file ", inQuotes(file), " has a row without a stamp, rates and accelerations: '", row,
           "'; fetch it again");
    }
    data.samples.push_back({parseStamp_ns(row, file), {n[1], n[2], n[3]}, {n[4], n[5], n[6]}});
  }
  return data;
}

StereoDataset StereoDataset::open(const std::string& folder) {
  const fs::path path(folder);
  try {
    if (!fs::exists(path)) fail("data set ", inQuotes(path), " does not exist: check the path");
    if (!fs::is_directory(path))
      fail("data set ", inQuotes(path), " is not a folder: give its folder");
    if (fs::exists(path / "mav0")) return openEuroc((path / "mav0").string());
    if (fs::exists(path / "cam0")) return openEuroc(folder);
    if (fs::exists(path / "image_0") || fs::exists(path / "calib.txt")) return openKitti(folder);
  } catch (const fs::filesystem_error& error) {
    fail("data set ", inQuotes(path), " cannot be read: ", error.code().message());
  }
  fail("folder ", inQuotes(path),
       " holds no data set: it must have image_0, image_1, calib.txt and ",
       "times.txt (KITTI) or mav0/cam0 and mav0/cam1 (EuRoC)");
}

StereoImages StereoDataset::load(std::size_t index) const {
  const Frame& frame = frames_.at(index);
  StereoImages images;
  images.left = readImage(frame.left_file);
  images.right = readImage(frame.right_file);
  images.stamp_ns = frame.stamp_ns;
  requireSize(images.left, frame.left_file, calibration_.left);
  requireSize(images.right, frame.right_file, calibration_.right);
  return images;
}

}  // namespace point_line_odometry
