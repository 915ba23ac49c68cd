#pragma once

#include <nav_msgs/Odometry.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"
#include "ros/frame_processor.h"

namespace point_line_odometry {

/// A pair as it was received, and the result of the odometry.
struct RecordedFrame {
  StereoMessages messages;
  nav_msgs::Odometry odometry;
  TrackingState state = TrackingState::kInitializing;
  TrackingReason reason = TrackingReason::kFirstFrame;
  Eigen::Isometry3d T_odom_camera = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_base_header = Eigen::Isometry3d::Identity();  ///< see ProcessedFrame
  std::shared_ptr<const Parameters> parameters;                     ///< used for this frame
  cv::Mat left_mask = {};   ///< used for this frame, see FrameMasks
  cv::Mat right_mask = {};  ///< the same for the right image
  std::optional<MotionPrior> prior = {};
  std::optional<TiltCorrection> tilt = {};
};

/// The odometry before a frame.
struct RecordedStart {
  std::string state;  ///< see StereoOdometry::saveState()
  Eigen::Isometry3d T_odom_base = Eigen::Isometry3d::Identity();
};

/// Consecutive frames and the state before the first of them: enough to reproduce their results.
struct Recording {
  std::shared_ptr<const RecordedStart> start;  ///< null: nothing is recorded
  std::vector<RecordedFrame> frames;
};

/// The latest frames of the odometry, in two halves that each begin with the state before them:
/// when the newer one is full, the older one is discarded. So between half and all of the capacity
/// can be replayed. Images are shared, not copied. Memory: the images of `max_frames` frames, at
/// most `max_bytes` and two pairs, and two states of about 10 MB. One thread may add frames while
/// others read recordings.
class FrameRing {
 public:
  FrameRing(std::size_t max_frames, std::size_t max_bytes);

  /// To be called before the odometry processes a frame. A frame that does not continue the
  /// previous one (reset, other calibration) starts a new recording. Every frame that the odometry
  /// accepts must be added, or all be cleared.
  void prepare(const FrameStart& start);

  /// To be called after the odometry has accepted that frame.
  void add(RecordedFrame frame);

  /// Discards all frames; the next one is the first one.
  void clear();

  /// What can be replayed now; shares all images.
  Recording recording() const;

 private:
  static std::size_t bytesOf(const RecordedFrame& frame, const RecordedFrame* before);

  struct Half {
    std::shared_ptr<const RecordedStart> start;
    std::vector<RecordedFrame> frames;
    std::size_t bytes = 0;
  };

  bool full(const Half& half) const;

  const std::size_t frames_of_half_;
  const std::size_t bytes_of_half_;
  mutable std::mutex mutex_;
  Half older_;
  Half newer_;
};

}  // namespace point_line_odometry
