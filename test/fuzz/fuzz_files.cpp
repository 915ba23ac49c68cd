/// Files that a user gives: trajectories, data sets with their calibration.

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <sstream>
#include <string>

#include "dataset/camera_info_file.h"
#include "dataset/dataset.h"
#include "dataset/dataset_writer.h"
#include "dataset/mask_file.h"
#include "dataset/trajectory.h"
#include "fuzz/fuzz_support.h"
#include "fuzz/fuzz_targets.h"
#include "ros/image_conversion.h"
#include "tools/prior_file.h"

namespace point_line_odometry {
namespace {

constexpr int kWidth = 16;
constexpr int kHeight = 12;
constexpr int kFrames = 2;
constexpr std::int64_t kStart_ns = 1000000000;
constexpr std::int64_t kPeriod_ns = 100000000;
constexpr const char* kPacket =
    "49 8 112 0 0 1 0 0 0 0 0 0.1 0.2 9.8 0 0 0 0.01 0.02 0.03 0 0 0 0 0 4 11 6 6 6\n";
constexpr const char* kMounting = "R: 1 0 0 0 1 0 0 0 1\nT: 0.1 0.2 0.3\n";

StereoCalibration calibration() {
  StereoCalibration pair;
  for (CameraCalibration* camera : {&pair.left, &pair.right}) {
    camera->width = kWidth;
    camera->height = kHeight;
    camera->D.assign(5, 0.0);
    camera->K << 20.0, 0.0, 8.0, 0.0, 20.0, 6.0, 0.0, 0.0, 1.0;
    camera->P.leftCols<3>() = camera->K;
  }
  pair.right.P(0, 3) = -2.0;
  return pair;
}

/// A complete data set of which one file can be replaced.
class TinyDataset {
 public:
  explicit TinyDataset(DatasetLayout layout) {
    DatasetWriter writer(folder_.file("").string(), layout, calibration(), 10.0);
    const cv::Mat image(kHeight, kWidth, CV_8UC1, cv::Scalar(80));
    for (int k = 0; k < kFrames; ++k) {
      writer.add({image, image, kStart_ns + k * kPeriod_ns}, Eigen::Isometry3d::Identity());
    }
    writer.finish();
    if (layout == DatasetLayout::kEuroc) {
      writer.writeImu({{{kStart_ns, {0.1, 0.2, 0.3}, {0.0, 0.0, 9.81}}}, {}});
    } else {
      folder_.write("oxts/timestamps.txt", "2011-09-26 13:02:25.964389445\n");
      folder_.write("oxts/data/0000000000.txt", kPacket);
      for (const char* file : {"calib_imu_to_velo.txt", "calib_velo_to_cam.txt"})
        folder_.write(file, kMounting);
      folder_.write("calib_cam_to_cam.txt", "R_rect_00: 1 0 0 0 1 0 0 0 1\n");
    }
  }

  /// Opens and reads the data set with `text` in one of the files, which is restored afterwards.
  void readWith(const std::string& file, const std::string& text) const {
    std::ostringstream whole;
    whole << std::ifstream(folder_.file(file), std::ios::binary).rdbuf();
    folder_.write(file, text);
    try {
      read(StereoDataset::open(folder_.file("").string()));
    } catch (const InputError&) {
      // the documented error of an unusable file
    } catch (...) {
      folder_.write(file, whole.str());
      throw;
    }
    folder_.write(file, whole.str());
  }

 private:
  static void read(const StereoDataset& dataset) {
    rectifiedCamera(dataset.calibration());  // open() has checked that it can be used
    require(dataset.size() > 0, "an open data set has frames");
    for (const StampedPose& pose : dataset.groundTruth()) {
      require(pose.T_world_camera.matrix().allFinite(), "ground truth is finite");
    }
    for (std::size_t i = 0; i < dataset.size(); ++i) {
      const StereoImages images = dataset.load(i);
      require(images.left.size() == images.right.size(), "images of a pair have one size");
    }
    if (const std::optional<ImuData> imu = dataset.readImu()) {
      require(imu->T_imu_camera.matrix().allFinite(), "the mounting of the IMU is finite");
      for (const ImuSample& sample : imu->samples)
        require(sample.angular_velocity.allFinite() && sample.acceleration.allFinite(),
                "samples are finite");
    }
    if (dataset.needsRectification())
      StereoRectifier(dataset.calibration()).rectify(dataset.load(0));
  }

  ScratchFolder folder_;
};

/// The first line, and the rest.
struct NamedText {
  std::string name;
  std::string text;
};

NamedText splitName(const std::string& bytes) {
  const std::size_t end = std::min(bytes.find('\n'), bytes.size());
  return {bytes.substr(0, end), bytes.substr(std::min(end + 1, bytes.size()))};
}

}  // namespace

void fuzzTrajectory(const std::uint8_t* data, std::size_t size) {
  static const ScratchFolder folder;
  const std::string file = folder.file("trajectory.tum").string();
  const auto read = [&file](const std::string& text) {
    folder.write("trajectory.tum", text);
    return readTum(file);
  };
  std::vector<StampedPose> poses;
  try {
    poses = read(toText(data, size));
  } catch (const InputError&) {
    return;
  }
  std::ostringstream written;
  writeTum(written, poses);
  const std::vector<StampedPose> again = read(written.str());
  require(again.size() == poses.size(), "writeTum() writes every pose");
  for (std::size_t i = 0; i < poses.size(); ++i) {
    require(again[i].stamp_ns == poses[i].stamp_ns, "writeTum() keeps stamps");
  }
}

void fuzzKitti(const std::uint8_t* data, std::size_t size) {
  static const TinyDataset dataset(DatasetLayout::kKitti);
  const NamedText input = splitName(toText(data, size));
  for (const char* file : {"calib.txt", "times.txt", "poses.txt"}) {
    if (input.name == file) dataset.readWith(file, input.text);
  }
  if (input.name == "timestamps.txt") dataset.readWith("oxts/timestamps.txt", input.text);
  if (input.name == "packet.txt") dataset.readWith("oxts/data/0000000000.txt", input.text);
  if (input.name == "calib_imu_to_velo.txt") dataset.readWith(input.name, input.text);
}

void fuzzEuroc(const std::uint8_t* data, std::size_t size) {
  static const TinyDataset dataset(DatasetLayout::kEuroc);
  const NamedText input = splitName(toText(data, size));
  if (input.name == "sensor.yaml") dataset.readWith("mav0/cam0/sensor.yaml", input.text);
  if (input.name == "data.csv") dataset.readWith("mav0/cam0/data.csv", input.text);
  if (input.name == "groundtruth.csv") {
    dataset.readWith("mav0/state_groundtruth_estimate0/data.csv", input.text);
  }
  if (input.name == "imu.csv") dataset.readWith("mav0/imu0/data.csv", input.text);
  if (input.name == "imu.yaml") dataset.readWith("mav0/imu0/sensor.yaml", input.text);
}

void fuzzPriors(const std::uint8_t* data, std::size_t size) {
  static const ScratchFolder folder;
  folder.write("priors.txt", toText(data, size));
  try {
    for (const auto& [stamp_ns, prior] : readPriors(folder.file("priors.txt").string())) {
      require(prior.to_ns == stamp_ns, "a prior is found by the stamp at which it ends");
      require(prior.T_prev_curr.matrix().allFinite() && prior.information.allFinite(),
              "priors are finite");
    }
  } catch (const InputError&) {
    // the documented error of an unusable file
  }
}

void fuzzCameraInfoFile(const std::uint8_t* data, std::size_t size) {
  static const ScratchFolder folder;
  const auto read = [](const std::string& text) {
    folder.write("camera.yaml", text);
    return readCameraInfo(folder.file("camera.yaml").string());
  };
  CameraCalibration camera;
  try {
    camera = read(toText(data, size));
  } catch (const InputError&) {
    return;  // the documented error of an unusable file
  }
  require(camera.width > 0 && camera.height > 0, "a camera has a size");
  require(camera.K.allFinite() && camera.R.allFinite() && camera.P.allFinite(),
          "matrices are finite");
  camera.distortion_model = "plumb_bob";  // any text is read, which yaml may have to quote
  const CameraCalibration again = read(formatCameraInfo(camera, "camera"));
  require(again.K == camera.K && again.R == camera.R && again.P == camera.P && again.D == camera.D,
          "formatCameraInfo() keeps every bit");
}

void fuzzMask(const std::uint8_t* data, std::size_t size) {
  static const ScratchFolder folder;
  const CameraCalibration camera = calibration().left;
  folder.write("mask", toText(data, size));
  try {
    const StaticMasks masks({folder.file("mask").string(), kNoMask});
    StereoImages images;
    images.left = images.right = cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(80));
    if (masks.sizeFault(calibration()).empty()) {
      masks.addTo(&images);
      require(images.left_mask.type() == CV_8UC1 && images.left_mask.size() == images.left.size(),
              "a mask has 8 bit, and the size of its image");
    }
  } catch (const InputError&) {
    // likewise
  }
  if (size < 4) return;
  sensor_msgs::Image message;
  message.encoding = data[0] % 3 == 0 ? "mono8" : data[0] % 3 == 1 ? "8UC1" : "mono16";
  message.width = data[1];
  message.height = data[2];
  message.step = data[3];
  message.data.assign(data + 4, data + size);
  try {
    const cv::Mat mask = toMask(message, camera);
    require(mask.type() == CV_8UC1 && mask.size() == cv::Size(kWidth, kHeight),
            "a mask message has 8 bit, and the size of its image");
  } catch (const MessageError&) {
    // likewise
  }
}

}  // namespace point_line_odometry
