#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/input_error.h"
#include "dataset/imu_data.h"
#include "dataset/trajectory.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// A folder of stereo images, KITTI odometry layout (image_0, image_1, calib.txt, times.txt,
/// optionally poses.txt) or EuRoC layout (mav0/cam0, mav0/cam1, optionally
/// mav0/state_groundtruth_estimate0; the folder may be mav0 or its parent).
class StereoDataset {
 public:
  struct Frame {
    std::int64_t stamp_ns = 0;
    std::string left_file;
    std::string right_file;
  };

  /// Reads the index and calibration, and one image for its size where the calibration does not
  /// have it (KITTI). Throws InputError if the folder is missing, empty, truncated (files of the
  /// index are missing, left and right differ in number) or its calibration unusable.
  static StereoDataset open(const std::string& folder);

  std::size_t size() const { return frames_.size(); }
  const Frame& frame(std::size_t index) const { return frames_[index]; }
  const StereoCalibration& calibration() const { return calibration_; }

  /// True if images are raw and must be rectified with calibration() (EuRoC).
  bool needsRectification() const { return needs_rectification_; }

  /// Images as stored, CV_8UC1. Throws InputError if a file does not decode or has another size
  /// than the calibration.
  StereoImages load(std::size_t index) const;

  /// Ground truth of the left camera as stored in the folder (raw left camera for raw images),
  /// empty if there is none. For KITTI it is poses.txt of the folder, or else ../../poses/NAME.txt
  /// as in the published data set.
  const std::vector<StampedPose>& groundTruth() const { return ground_truth_; }

  /// Reads the samples of the IMU; nothing if the folder has none (mav0/imu0 of EuRoC, oxts of
  /// KITTI raw beside the images, see readOxts()). Throws InputError if they are damaged.
  std::optional<ImuData> readImu() const;

  /// Pose of the left camera in the body (EuRoC's T_BS; for KITTI none).
  const std::optional<Eigen::Isometry3d>& T_body_camera() const { return T_body_camera_; }

 private:
  static StereoDataset openKitti(const std::string& folder);
  static StereoDataset openEuroc(const std::string& folder);

  std::vector<Frame> frames_;
  StereoCalibration calibration_;
  bool needs_rectification_ = false;
  std::vector<StampedPose> ground_truth_;
  std::optional<Eigen::Isometry3d> T_body_camera_;
  std::string imu_folder_;   // empty: none
  std::string oxts_folder_;  // likewise: in which oxts is
};

}  // namespace point_line_odometry
