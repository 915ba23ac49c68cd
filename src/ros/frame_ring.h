#pragma once

#include <nav_msgs/Odometry.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "point_line_odometry/stereo_odometry.h"
#include "ros/frame_processor.h"

namespace point_line_odometry {

/// A pair as it was received, and what the odometry made of it.
struct RecordedFrame {
  StereoMessages messages;
  nav_msgs::Odometry odometry;
  TrackingState state = TrackingState::kInitializing;
  TrackingReason reason = TrackingReason::kFirstFrame;
  Eigen::Isometry3d T_odom_camera = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_base_header = Eigen::Isometry3d::Identity();  ///< see ProcessedFrame
  std::shared_ptr<const Parameters> parameters;                     ///< in force at this frame
};

/// The odometry before a frame.
struct RecordedStart {
  std::string state;  ///< see StereoOdometry::saveState()
  Eigen::Isometry3d T_odom_base = Eigen::Isometry3d::Identity();
};

/// Frames in a row, and the state before the first of them: enough to process them again with the
/// same result.
struct Recording {
  std::shared_ptr<const RecordedStart> start;  ///< null: nothing is recorded
  std::vector<RecordedFrame> frames;
};

/// The last frames that the odometry took, in two halves that each begin with the state before
/// them: when one is full, the other one is given up. So between a half and the whole of the
/// capacity is there to be replayed. Images are shared, not copied. Memory: the images of
/// `max_frames` frames, at most `max_bytes` and two pairs, and two states of about 10 MB. One
/// thread may add frames while others take recordings.
class FrameRing {
 public:
  FrameRing(std::size_t max_frames, std::size_t max_bytes);

  /// To be called before the odometry takes a frame. A frame that does not continue the one before
  /// (reset, other calibration) is the first one: what was before cannot be replayed up to it.
  /// Every frame that the odometry accepts must be added, or all be cleared.
  void prepare(const FrameStart& start);

  /// To be called after the odometry took that frame.
  void add(RecordedFrame frame);

  /// Forgets all; the next frame is the first one.
  void clear();

  /// What can be replayed now; shares all images.
  Recording recording() const;

 private:
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
