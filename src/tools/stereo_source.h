#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dataset/imu_data.h"
#include "dataset/trajectory.h"
#include "dataset/wheel_data.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Stereo pairs in order of time, from a folder, a bag or the synthetic world.
class StereoSource {
 public:
  virtual ~StereoSource() = default;

  /// Number of pairs to be expected, for the progress bar.
  virtual std::size_t size() const = 0;
  virtual const StereoCalibration& calibration() const = 0;
  virtual bool needsRectification() const = 0;

  /// The next pair as stored, with its masks if it has some; nothing at the end. Throws InputError
  /// if it cannot be read.
  virtual std::optional<StereoImages> next() = 0;

  /// Skips the next pair; false at the end.
  virtual bool skip() { return next().has_value(); }

  /// Images skipped as they had no partner.
  virtual std::size_t unsynchronized() const { return 0; }

  /// A sentence for each kind of data that was left out so far, as it cannot be used.
  virtual std::vector<std::string> warnings() const { return {}; }

  /// True poses of the left camera (the raw one for raw images), empty if they are not known.
  virtual std::vector<StampedPose> groundTruth() const { return {}; }

  /// All samples of the IMU on the camera, nothing if there is none.
  virtual std::optional<ImuData> imu() { return std::nullopt; }

  /// The whole odometry of the wheels, nothing if there is none.
  virtual std::optional<WheelData> wheels() { return std::nullopt; }

  /// Pose of the left camera in base_link, which lies in it with x ahead and z up unless the source
  /// knows better.
  virtual Eigen::Isometry3d T_base_camera();
};

/// Pairs of a KITTI or EuRoC folder. Throws InputError if it is not one, or damaged.
std::unique_ptr<StereoSource> openFolder(const std::string& folder);

/// Number of pairs to be expected with at most `limit` pairs (0: all).
std::size_t expectedSize(const StereoSource& source, std::size_t limit);

/// Calls `take` with `limit` pairs (0: all) of a source in turn, with a progress bar unless
/// `quiet`. Throws Interrupted after a signal.
void forEachPair(StereoSource& source, std::size_t limit, bool quiet,
                 const std::function<void(const StereoImages&)>& take);

}  // namespace point_line_odometry
