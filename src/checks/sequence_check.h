#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "checks/followed_frame.h"
#include "checks/image_repetitions.h"
#include "checks/resting_pattern.h"
#include "features/features.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// What consecutive rectified pairs tell of their cameras, without calibration and odometry.
struct SequenceMeasurement {
  int frames = 0;

  /// By how much later the right images are taken than the left ones, whatever their stamps say,
  /// with its standard deviation; nothing if no motion shows it.
  std::optional<double> delay_s;
  double delay_sigma_s = 0.0;

  /// By how much later the last row is exposed than the first one, with its standard deviation;
  /// nothing if the camera is not known or no motion shows it.
  std::optional<double> read_out_s;
  double read_out_sigma_s = 0.0;
  double period_s = 0.0;  ///< from frame to frame, median
  int bursts = 0;         ///< frames much sooner after the one before than their neighbours

  double speed_px_s = 0.0;  ///< of the points in the image, the fastest tenth apart

  RestingPattern pattern;

  int pairs = 0;  ///< received; frames without those of which one image is repeated
  /// Images that are those of the pair before, while the other one is not; of both, of at most two
  /// pairs in a row.
  int repeated_left = 0;
  int repeated_right = 0;  ///< the same of the right camera

  /// True if the delay is there beyond doubt and shifts points by more than their noise.
  bool notSimultaneous() const;

  /// True if rows are exposed one after the other beyond doubt, over a tenth of the period or more,
  /// and this shifts points by more than their noise.
  bool hasRollingShutter() const;

  /// True if there are too many bursts for a camera that takes frames at a steady rate and may drop
  /// some: they are stamped when they arrive.
  bool hasArrivalStamps() const;
};

/// Follows points through consecutive pairs, for measureDelay(), measureReadOut() and
/// findRestingPattern(), and looks for repeated images and irregular stamps.
class SequenceCheck {
 public:
  /// \param left camera of the pairs; without it a rolling shutter is not looked for.
  explicit SequenceCheck(std::optional<CameraCalibration> left = std::nullopt)
      : left_(std::move(left)) {}

  /// Takes the next pair; its points are kept. \param rectified CV_8UC1; other images, and stamps
  /// that do not increase, interrupt the sequence.
  void add(const StereoImages& rectified);

  SequenceMeasurement measurement() const;

 private:
  void track(const cv::Mat& left, const std::vector<Keypoint>& keypoints,
             FollowedFrame* from) const;

  std::optional<CameraCalibration> left_;
  int pairs_ = 0;
  ImageRepetitions repetitions_;
  cv::Mat last_left_;  // empty: the next frame does not follow
  std::vector<Keypoint> last_keypoints_;
  std::int64_t last_stamp_ns_ = 0;
  std::vector<FollowedFrame> frames_;
};

}  // namespace point_line_odometry
