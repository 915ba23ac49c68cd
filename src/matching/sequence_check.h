#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "features/features.h"
#include "matching/followed_frame.h"
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
  int early = 0;          ///< frames much sooner after the one before than its neighbours

  double speed_px_s = 0.0;  ///< of the points in the image, the fastest tenth apart

  int compared = 0;       ///< points among others of the same depth, which move
  int resting = 0;        ///< those of them that rest in the image
  int resting_cells = 0;  ///< of 4 x 3 parts of the image, those with several of them

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

  /// True if too many frames are early for a camera that takes them at a steady rate and may drop
  /// some: they are stamped when they arrive.
  bool hasArrivalStamps() const;

  /// True if a pattern rests in the image while the scene moves: that of a projector at the camera.
  bool hasRestingPattern() const;
};

/// By how much later the right images are taken.
struct SequenceDelay {
  double seconds = 0.0;
  double variance = 0.0;  ///< [s^2]
};

/// Follows points through consecutive pairs.
///
/// Delay s of the right image: a point that moves with the velocity (vx, vy) in the image is
/// shifted there by s (vx, vy). Its vertical disparity is s vy, beside what a wrong calibration
/// does, which is smooth over the image and the disparity d; and its disparity changes by -s times
/// the change of vx, beside what the camera's motion does, in first order a combination of 1, d^2,
/// d x and d y. The velocities are those of a smooth field that is fitted to all points.
///
/// Rolling shutter: see measureReadOut().
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
  using Terms = Eigen::Matrix<double, 1, 10>;
  using Field = Eigen::Matrix<double, 10, 2>;  // coefficients of the terms: velocity [px/s]

  static constexpr int kRestingColumns = 4;
  static constexpr int kRestingRows = 3;

  using Point = FollowedPoint;

  struct Frame : FollowedFrame {
    std::optional<Field> field;  // of the velocities until the next frame
  };

  static void matchStereo(const StereoImages& images, const std::vector<Keypoint>& left,
                          Frame* frame);
  void track(const cv::Mat& left, const std::vector<Keypoint>& keypoints, Frame* from) const;
  static Terms terms(const Frame& frame, const Point& point);
  static void fitField(Frame* frame);
  bool countRepeated(const StereoImages& rectified);
  static std::size_t cellOf(const Frame& frame, const Point& point, int columns, int rows);
  static void countResting(const Frame& frame, SequenceMeasurement* measurement,
                           std::vector<int>* cells);
  std::optional<SequenceDelay> delayByRows() const;
  std::optional<SequenceDelay> delayByColumns() const;

  std::optional<CameraCalibration> left_;
  cv::Mat last_left_;  // empty: the next frame does not follow
  cv::Mat last_right_;
  int pairs_ = 0;
  int repeated_left_ = 0;
  int repeated_right_ = 0;
  int same_pairs_ = 0;  // in a row, of the latest ones
  std::vector<Keypoint> last_keypoints_;
  std::int64_t last_stamp_ns_ = 0;
  std::vector<Frame> frames_;
};

}  // namespace point_line_odometry
