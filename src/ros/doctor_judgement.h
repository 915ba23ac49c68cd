#pragma once

/// \file
/// What is wrong with the input of the odometry, and what to do about it: facts in, lines out. Free
/// functions that need no node; the nodelet and the tool `doctor` share them.

#include <Eigen/Geometry>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "point_line_odometry/pair_check.h"
#include "point_line_odometry/stereo_camera.h"
#include "ros/doctor_report.h"
#include "ros/node_parameters.h"
#include "ros/stereo_input.h"

namespace point_line_odometry {

/// The latest image of one camera.
struct ImageFacts {
  std::string encoding;
  int width = 0;      ///< [px]
  int height = 0;     ///< [px]
  std::string fault;  ///< why it cannot be used, with the cure; empty if it can
};

/// Everything that the report is made of.
struct DoctorFacts {
  NodeParameters parameters;
  InputFacts input;
  bool from_bag = false;
  std::vector<std::string> image_topics;  ///< that there are, if a topic is missing

  /// True if use_sim_time is set and no clock ticks.
  bool clock_stands = false;

  std::array<std::optional<ImageFacts>, 2> images;  ///< left, right; nothing: none came
  std::optional<StereoCamera> camera;               ///< nothing: not known, or camera_info is bad
  std::string calibration_fault;                    ///< with the cure; empty if there is none

  std::optional<PairMeasurement> pair;  ///< nothing: not measured yet
  std::optional<double> row_drift_px;   ///< of row_offset_px since the start

  std::string camera_frame;  ///< of the left image's header
  std::optional<Eigen::Isometry3d> T_base_camera;

  std::optional<double> frame_ms;  ///< median time for a frame on this computer
};

/// Median row difference of matched points beyond which a pair does not count as rectified.
constexpr double kMaxRowDistance_px = 1.5;

/// Change of the median row difference since the start that counts as a calibration that moves.
constexpr double kMaxRowDrift_px = 0.5;

/// The lines of the report.
std::vector<DoctorLine> examine(const DoctorFacts& facts);

/// The lines that need no message to be looked into: those of the topics and their stamps.
std::vector<DoctorLine> examineTopics(const DoctorFacts& facts);

}  // namespace point_line_odometry
