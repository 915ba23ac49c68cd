#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <Eigen/Geometry>
#include <functional>
#include <memory>
#include <optional>

#include "point_line_odometry/rectification.h"
#include "point_line_odometry/stereo_odometry.h"
#include "ros/confirmation.h"
#include "ros/frame_messages.h"
#include "ros/node_parameters.h"

namespace point_line_odometry {

/// A stamp older by up to so much is that of a message that comes late; by more, the clock has
/// jumped back [s].
constexpr double kMaxLateness_s = 1.0;

/// One synchronised set of input messages.
struct StereoMessages {
  sensor_msgs::ImageConstPtr left;
  sensor_msgs::ImageConstPtr right;
  sensor_msgs::CameraInfoConstPtr left_info;
  sensor_msgs::CameraInfoConstPtr right_info;
};

/// The odometry as it is before it takes a frame.
struct FrameStart {
  StereoOdometry& odometry;
  bool continues;                 ///< false after a start, reset, other calibration or exception
  Eigen::Isometry3d T_odom_base;  ///< at the last frame, or where this one starts
};

/// Leads one set of messages after the other through the core, and keeps what the core knows
/// nothing of: the calibration that comes with each frame, the place of the camera on the robot,
/// and what to do when the clock jumps back. Jumps are to be confirmed before (StampFilter);
/// another calibration is taken when kConfirmations frames in a row have it. Needs no node; not
/// thread-safe.
class FrameProcessor {
 public:
  explicit FrameProcessor(AllParameters parameters);

  /// Converts, rectifies if asked to, and tracks.
  /// \param T_base_header pose in the base of the frame that the left image's header names (the raw
  /// camera if images are raw). Throws MessageError if a message cannot be used; the state is then
  /// as before. Throws std::runtime_error if the core gives a number that is not finite.
  ProcessedFrame process(const StereoMessages& messages, const Eigen::Isometry3d& T_base_header);

  /// Forgets the past; the base has this pose at the next frame.
  void reset(const Eigen::Isometry3d& T_odom_base);

  /// Takes other parameters of the core, which must be allowed, from the next frame on.
  void setParameters(const Parameters& core);

  /// `observe` is called before each frame that the odometry takes.
  void observeStarts(std::function<void(const FrameStart&)> observe);

  /// Uses this share of the numbers of features in the parameters from the next frame on.
  void setFeatureBudget(double share);

  /// True if the last call of process() found the clock jumped back and began anew.
  bool startedAnew() const { return started_anew_; }

 private:
  struct InfoPair {
    sensor_msgs::CameraInfoConstPtr left;
    sensor_msgs::CameraInfoConstPtr right;

    bool operator==(const InfoPair& other) const;
  };

  /// What follows from a pair of camera_infos.
  struct Calibration {
    InfoPair infos;
    StereoCalibration stereo;
    StereoCamera camera;
    std::optional<StereoRectifier> rectifier;

    Eigen::Isometry3d T_header_camera() const;
  };

  StereoImages receive(const StereoMessages& messages);
  static Calibration makeCalibration(const InfoPair& infos);
  [[noreturn]] void rejectUnconfirmed(const InfoPair& infos) const;
  void takeCalibration(Calibration calibration);
  void handleTimeJump(std::int64_t stamp_ns);
  void takeMounting(const Eigen::Isometry3d& T_base_camera);
  void startOdometry();
  Parameters budgetedParameters() const;

  AllParameters parameters_;
  std::optional<Calibration> calibration_;
  Confirmation<InfoPair> other_infos_;
  std::optional<StereoOdometry> odometry_;
  Eigen::Isometry3d T_base_camera_ = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_odom_base_;  // at the last frame, or where the next one starts
  std::optional<std::int64_t> last_stamp_ns_;
  bool started_anew_ = false;
  bool continues_ = false;  // nothing has come between the last frame and the next one
  std::function<void(const FrameStart&)> observe_start_;
  double feature_budget_ = 1.0;
};

}  // namespace point_line_odometry
