#pragma once

#include <sensor_msgs/Image.h>
#include <tf2/buffer_core.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <deque>
#include <optional>
#include <string>

#include "point_line_odometry/pair_check.h"
#include "point_line_odometry/rectification.h"
#include "ros/doctor_judgement.h"
#include "ros/node_parameters.h"
#include "ros/stereo_input.h"

namespace point_line_odometry {

/// What measurements of the pair say over time: medians of the latest ones, and how far rows have
/// moved since the first ones. Bounded.
class PairTrend {
 public:
  static constexpr std::size_t kWindow = 5;

  void add(const PairMeasurement& measurement);

  /// Nothing before the first measurement. Counts are those of the latest one; if that found no
  /// matches it stands for itself.
  std::optional<PairMeasurement> current() const;

  /// Change of row_offset_px since the first kWindow valid measurements; nothing before there are
  /// so many.
  std::optional<double> rowDrift_px() const;

 private:
  std::deque<PairMeasurement> window_;  // valid ones
  std::optional<PairMeasurement> latest_;
  std::optional<double> first_row_offset_px_;
};

/// Gathers the facts of a report. Measures pairs of images when it is told to, as that takes about
/// as long as a frame of the odometry. Needs no node; not thread-safe.
class DoctorExamination {
 public:
  explicit DoctorExamination(const NodeParameters& parameters);

  /// Measures the images of a set, rectified first if the node does so. A set that cannot be used
  /// is passed over: the facts say why. A new calibration starts a new trend.
  void measure(const StereoMessages& set);

  /// \param tf knows where the camera sits, or not. What only the caller can know is left out:
  /// image_topics, from_bag, clock_stands, frame_ms.
  DoctorFacts facts(const InputFacts& input, const tf2::BufferCore& tf);

 private:
  void takeCalibration(const StereoMessages& messages);
  StereoImages rectify(const StereoImages& raw);
  std::optional<Eigen::Isometry3d> findMounting(const std::string& camera_frame,
                                                const tf2::BufferCore& tf) const;

  const NodeParameters parameters_;

  sensor_msgs::CameraInfoConstPtr left_info_;  // that what follows is of
  sensor_msgs::CameraInfoConstPtr right_info_;
  StereoCalibration calibration_;
  std::optional<StereoCamera> camera_;
  std::optional<StereoRectifier> rectifier_;
  std::string calibration_fault_;
  PairTrend trend_;
};

}  // namespace point_line_odometry
