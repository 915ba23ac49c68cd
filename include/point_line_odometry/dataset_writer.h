#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "point_line_odometry/rectification.h"
#include "point_line_odometry/trajectory.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// How a folder of stereo images is laid out; see StereoDataset.
enum class DatasetLayout {
  kKitti,  ///< rectified images: image_0, image_1, calib.txt, times.txt, poses.txt
  kEuroc   ///< raw images: mav0/cam0, mav0/cam1, mav0/state_groundtruth_estimate0
};

/// Writes stereo images with their ground truth to a folder that StereoDataset::open() and other
/// readers of the layout take. Images, stamps and the calibration are read back as they were. The
/// body of EuRoC's files is the left camera.
class DatasetWriter {
 public:
  /// \param folder where to write; it must exist.
  /// \param calibration of rectified images (KITTI) or raw ones (EuRoC).
  DatasetWriter(const std::string& folder, DatasetLayout layout,
                const StereoCalibration& calibration, double frame_rate_hz);

  /// Adds a frame, later than those before. Throws InputError if it cannot be written.
  /// \param T_world_camera true pose of the left camera (the raw one for raw images).
  void add(const StereoImages& images, const Eigen::Isometry3d& T_world_camera);

  /// Writes index, calibration and ground truth; the folder is whole then. Throws InputError if
  /// that fails.
  void finish() const;

 private:
  void finishKitti() const;
  void finishEuroc() const;
  std::string imageFile(int side, std::int64_t stamp_ns) const;
  void writeText(const std::string& name, const std::string& text) const;

  std::string folder_;
  DatasetLayout layout_;
  StereoCalibration calibration_;
  double frame_rate_hz_;
  std::vector<StampedPose> poses_;
};

}  // namespace point_line_odometry
