#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <Eigen/Geometry>
#include <functional>
#include <memory>
#include <optional>

#include "dataset/mask_file.h"
#include "odometry/adaptive_feature_budget.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/stereo_odometry.h"
#include "point_line_odometry/types.h"
#include "priors/prior_sources.h"
#include "ros/calibration_conversion.h"
#include "ros/confirmation.h"
#include "ros/frame_messages.h"
#include "ros/node_parameters.h"

namespace point_line_odometry {

/// A message whose stamp is older by at most this is late; by more, the clock has jumped back [s].
constexpr double kMaxLateness_s = 1.0;

/// One synchronised set of input messages.
struct StereoMessages {
  sensor_msgs::ImageConstPtr left;
  sensor_msgs::ImageConstPtr right;
  sensor_msgs::CameraInfoConstPtr left_info;
  sensor_msgs::CameraInfoConstPtr right_info;
  sensor_msgs::ImageConstPtr left_mask = nullptr;  ///< with the stamp of its image; null: none
  sensor_msgs::ImageConstPtr right_mask = nullptr;
};

/// The odometry before it processes a frame.
struct FrameStart {
  StereoOdometry& odometry;
  bool continues;                 ///< false after a start, reset, other calibration or exception
  Eigen::Isometry3d T_odom_base;  ///< at the last frame, or initial pose of this one
};

/// Processes sets of messages with the core, and handles what the core does not: camera_info that
/// comes with each frame, the mounting of the camera on the robot, and clocks that jump back. Jumps
/// must be confirmed before (StampFilter); another calibration is accepted when kConfirmations
/// frames in a row have it. Needs no node; not thread-safe.
class FrameProcessor {
 public:
  /// Throws InputError if a mask file cannot be read.
  explicit FrameProcessor(AllParameters parameters);

  /// Converts, rectifies (with `rectify`), and tracks.
  /// \param T_base_header pose in the base of the frame that the left image's header names (the raw
  /// camera if images are raw). Throws MessageError if a message cannot be used; the state is then
  /// as before. Throws std::runtime_error if the core returns a number that is not finite.
  ProcessedFrame process(const StereoMessages& messages, const Eigen::Isometry3d& T_base_header);

  /// To be called before the samples until a frame are added. If the clock jumps back with the
  /// frame, samples from before are dropped: the stamps of new ones are as old.
  void announce(std::int64_t stamp_ns);

  /// IMU, wheels and floor, which take their samples between announce() and process().
  PriorSources& priorSources() { return prior_sources_; }
  const PriorSources& priorSources() const { return prior_sources_; }

  /// Resets the odometry; the base has this pose at the next frame.
  void reset(const Eigen::Isometry3d& T_odom_base);

  /// Uses other parameters of the core, which must be valid, from the next frame on.
  void setParameters(const Parameters& core);

  /// `observe` is called before each frame that the odometry processes.
  void observeStarts(std::function<void(const FrameStart&)> observe);

  /// Uses the parameters with this budget from the next frame on.
  void setFeatureBudget(const FeatureBudget& budget);

  /// True if the last call of process() reset the odometry as the clock had jumped back.
  bool wasReset() const { return was_reset_; }

 private:
  /// A pair of camera_infos and what is computed from them.
  struct Calibration {
    InfoPair infos;
    StereoCalibration stereo;
    StereoCamera camera;
    std::optional<StereoRectifier> rectifier;

    Eigen::Isometry3d T_header_camera() const;
  };

  StereoImages receive(const StereoMessages& messages);
  void takeMasks(const StereoMessages& messages, StereoImages* received, FrameMasks* masks) const;
  static Calibration makeCalibration(const InfoPair& infos);
  [[noreturn]] void rejectUnconfirmed(const InfoPair& infos) const;
  void takeCalibration(Calibration calibration);
  void handleTimeJump(std::int64_t stamp_ns);
  void takeMounting(const Eigen::Isometry3d& T_base_camera);
  void startOdometry();
  void continueOdometry();
  Parameters budgetedParameters() const;

  AllParameters parameters_;
  StaticMasks static_masks_;
  std::optional<Calibration> calibration_;
  Confirmation<InfoPair> other_infos_;
  std::optional<StereoOdometry> odometry_;
  PriorSources prior_sources_;
  Eigen::Isometry3d T_base_camera_ = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_odom_base_;  // at the last frame, or initial pose of the next one
  std::optional<std::int64_t> last_stamp_ns_;
  std::optional<std::int64_t> newest_stamp_ns_;  // since the last jump; a reset keeps it
  bool was_reset_ = false;
  bool continues_ = false;  // as in FrameStart
  std::function<void(const FrameStart&)> observe_start_;
  FeatureBudget feature_budget_;
};

}  // namespace point_line_odometry
