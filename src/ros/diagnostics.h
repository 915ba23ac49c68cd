#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/node_handle.h>

#include <Eigen/Core>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "ros/doctor_facts.h"
#include "ros/doctor_report.h"
#include "ros/frame_messages.h"
#include "ros/log_throttle.h"
#include "ros/node_parameters.h"
#include "ros/source_facts.h"
#include "ros/stereo_subscriber.h"

namespace point_line_odometry {

/// State of the node, published on /diagnostics by a timer. Thread-safe: the worker thread notes
/// frames, the doctor's thread its report, and a timer calls update().
class Diagnostics {
 public:
  Diagnostics(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
              const NodeParameters& parameters, const std::string& name);

  Diagnostics(const Diagnostics&) = delete;
  Diagnostics& operator=(const Diagnostics&) = delete;

  /// A frame was processed; it counts as rejected if the core did not accept it.
  void noteFrame(const ProcessedFrame& frame, double latency_ms);
  void noteDropped();
  void noteRejected(const std::string& reason);
  void noteException(const std::string& text);
  /// \param text topic and fault of a message that was rejected for its stamp.
  void noteRejectedStamp(const std::string& text);
  void notePaused(bool paused);
  void noteWaitingForTransform(const std::string& text);
  /// Nothing: it is not used (any more).
  void noteImu(std::optional<SourceFacts> imu);
  void noteWheels(std::optional<SourceFacts> wheels);
  void noteCheck(const std::vector<DoctorLine>& lines);

  FrameCounters counters() const;

  /// Nothing before the first frame.
  std::optional<MaskFacts> masks() const;

  /// StereoCorrection::rmsPx() of the odometry; nothing before the first frame.
  std::optional<Eigen::Vector2d> correctionPx() const;

  /// Nothing before the first frame, and without such a source.
  std::optional<SourceFacts> imu() const;
  std::optional<SourceFacts> wheels() const;

  /// Mean time for the latest frames [ms]; nothing before the second frame.
  std::optional<double> meanFrameMs() const;

  /// Publishes the state; warns in the log if no set of images has come for too long.
  void update(const StereoSubscriber& subscriber);

 private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void noteRepeatedImages();
  void watchInput(const StereoSubscriber& subscriber);
  void reportTracking(Status& status);
  void reportInput(Status& status);
  void reportPriors(Status& status) const;
  void reportCalibration(Status& status);
  double takeRate();

  std::optional<Eigen::Vector2d> correction_px_;  // guarded by mutex_; first, as it is aligned
  const double watchdog_timeout_s_;
  LogThrottle log_throttle_;

  mutable std::mutex mutex_;  // guards everything below but the updater
  FrameCounters counters_;
  bool paused_ = false;
  TrackingState state_ = TrackingState::kInitializing;
  TrackingReason reason_ = TrackingReason::kFirstFrame;
  double latency_ms_ = 0.0;
  double feature_budget_ = 1.0;
  std::optional<LineDetectorKind> line_detector_;  // of the last frame
  std::uint64_t failed_windows_ = 0;               // bundle adjustments that failed
  std::deque<double> process_ms_;                  // of the latest frames
  std::optional<MaskFacts> masks_;
  std::vector<DoctorLine> doctor_lines_;
  std::optional<SourceFacts> imu_;            // nothing unless imu/enabled
  std::optional<SourceFacts> wheels_;         // nothing without
  PriorReport prior_;                         // of the last frame
  std::map<PriorUse, std::uint64_t> priors_;  // frames by the use of their prior
  bool floor_trusted_ = true;
  std::string problem_;         // of the last frame, empty if there is none
  std::string timeout_;         // why no images are received, empty if they are
  std::string rejected_stamp_;  // the last one
  std::optional<ros::WallTime> time_of_rejected_stamp_;
  std::uint64_t repeated_images_ = 0;  // frames
  std::optional<ros::WallTime> time_of_repeated_images_;
  std::uint64_t num_sets_ = 0;
  std::uint64_t num_unsynchronized_ = 0;
  std::uint64_t processed_at_last_rate_ = 0;
  ros::WallTime time_of_last_rate_;

  diagnostic_updater::Updater updater_;
};

}  // namespace point_line_odometry
