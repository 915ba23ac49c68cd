/// Files that a user gives: trajectories, data sets with their calibration.

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <string>

#include "fuzz/fuzz_support.h"
#include "fuzz/fuzz_targets.h"
#include "point_line_odometry/dataset.h"
#include "point_line_odometry/dataset_writer.h"
#include "point_line_odometry/trajectory.h"

namespace point_line_odometry {
namespace {

constexpr int kWidth = 16;
constexpr int kHeight = 12;
constexpr int kFrames = 2;
constexpr std::int64_t kStart_ns = 1000000000;
constexpr std::int64_t kPeriod_ns = 100000000;

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

/// A whole data set of which one file can be replaced.
class TinyDataset {
 public:
  explicit TinyDataset(DatasetLayout layout) {
    DatasetWriter writer(folder_.file("").string(), layout, calibration(), 10.0);
    const cv::Mat image(kHeight, kWidth, CV_8UC1, cv::Scalar(80));
    for (int k = 0; k < kFrames; ++k) {
      writer.add({image, image, kStart_ns + k * kPeriod_ns}, Eigen::Isometry3d::Identity());
    }
    writer.finish();
  }

  /// Opens and reads all that can be read with `text` in one of the files, which is put back.
  void readWith(const std::string& file, const std::string& text) const {
    std::ostringstream whole;
    whole << std::ifstream(folder_.file(file), std::ios::binary).rdbuf();
    folder_.write(file, text);
    try {
      read(StereoDataset::open(folder_.file("").string()));
    } catch (const InputError&) {
      // what a file that cannot be used shall give
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
    if (dataset.needsRectification())
      StereoRectifier(dataset.calibration()).rectify(dataset.load(0));
  }

  ScratchFolder folder_;
};

/// First line, and what follows it.
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
}

void fuzzEuroc(const std::uint8_t* data, std::size_t size) {
  static const TinyDataset dataset(DatasetLayout::kEuroc);
  const NamedText input = splitName(toText(data, size));
  if (input.name == "sensor.yaml") dataset.readWith("mav0/cam0/sensor.yaml", input.text);
  if (input.name == "data.csv") dataset.readWith("mav0/cam0/data.csv", input.text);
  if (input.name == "groundtruth.csv") {
    dataset.readWith("mav0/state_groundtruth_estimate0/data.csv", input.text);
  }
}

}  // namespace point_line_odometry
