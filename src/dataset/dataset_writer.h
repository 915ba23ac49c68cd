#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "dataset/imu_data.h"
#include "dataset/trajectory.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Layout of a folder of stereo images; see StereoDataset.
enum class DatasetLayout {
  kKitti,  ///< rectified images: image_0, image_1, calib.txt, times.txt, poses.txt
  kEuroc   ///< raw images: mav0/cam0, mav0/cam1, mav0/state_groundtruth_estimate0
};

/// Writes stereo images with their ground truth to a folder for StereoDataset::open() and other
/// readers of the layout. Images, stamps and the calibration are read back unchanged. The
/// body of EuRoC's files is the left camera. The masks of the first frame, if it has some, become
/// mask_left.png and mask_right.png.
class DatasetWriter {
 public:
  /// \param folder where to write; it must exist.
  /// \param calibration of rectified images (KITTI) or raw ones (EuRoC).
  DatasetWriter(const std::string& folder, DatasetLayout layout,
                const StereoCalibration& calibration, double frame_rate_hz);

  /// Adds a frame, later than those before. Throws InputError if it cannot be written.
  /// \param T_world_camera true pose of the left camera (the raw one for raw images).
  void add(const StereoImages& images, const Eigen::Isometry3d& T_world_camera);

  /// Writes the IMU's samples to EuRoC's mav0/imu0; KITTI's layout has no place for them. Throws
  /// InputError if that fails.
  void writeImu(const ImuData& imu) const;

  /// Writes index, calibration and ground truth; the folder is complete then. Throws InputError if
  /// that fails.
  void finish() const;

 private:
  void finishKitti() const;
  void finishEuroc() const;
  std::string imageFile(int side, std::int64_t stamp_ns) const;
  void writeImage(const std::string& file, const cv::Mat& image) const;
  void writeText(const std::string& name, const std::string& text) const;

  std::string folder_;
  DatasetLayout layout_;
  StereoCalibration calibration_;
  double frame_rate_hz_;
  std::vector<StampedPose> poses_;
};

}  // namespace point_line_odometry
