#pragma once

/// \file
/// What is wrong with the input of the odometry, and what to do about it: facts in, lines out. Free
/// functions that need no node; the nodelet and the tool `doctor` share them.

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/time.h>

#include <Eigen/Geometry>
#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "point_line_odometry/pair_check.h"
#include "point_line_odometry/stereo_camera.h"
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

enum class DoctorLevel { kOk, kUnknown, kWarn, kError };  ///< in the order of their weight

const char* toString(DoctorLevel level);

/// What a line is about, in the order of the report.
enum class DoctorSubject {
  kLeftImage,
  kRightImage,
  kLeftInfo,
  kRightInfo,
  kStamps,
  kImages,
  kCalibration,
  kBaseline,
  kRectification,
  kDisparity,
  kMounting,
  kSpeed,
  kClock
};

const char* toString(DoctorSubject subject);

/// One line of the report.
struct DoctorLine {
  DoctorSubject subject = DoctorSubject::kLeftImage;
  DoctorLevel level = DoctorLevel::kOk;
  std::string text;
  std::string cure;  ///< empty for kOk and kUnknown, never for the others
  std::vector<std::pair<std::string, std::string>> values;  ///< what was measured, with units

  bool failed() const { return level >= DoctorLevel::kWarn; }
};

/// Median row difference of matched points beyond which a pair does not count as rectified.
constexpr double kMaxRowDistance_px = 1.5;

/// Change of the median row difference since the start that counts as a calibration that moves.
constexpr double kMaxRowDrift_px = 0.5;

/// The lines of the report.
std::vector<DoctorLine> examine(const DoctorFacts& facts);

/// The lines that need no message to be looked into: those of the topics and their stamps.
std::vector<DoctorLine> examineTopics(const DoctorFacts& facts);

/// The heaviest level of the lines, kOk for none.
DoctorLevel worstLevel(const std::vector<DoctorLine>& lines);

/// "2 errors, 1 warning, 3 not known yet", or "all is well".
std::string summarize(const std::vector<DoctorLine>& lines);

/// The report for a terminal: a row for each line, its cure below it.
std::string formatReport(const std::vector<DoctorLine>& lines);

/// One status per line, as rqt shows them; the cure stands in the message and among the values.
diagnostic_msgs::DiagnosticArray toDiagnosticArray(const std::vector<DoctorLine>& lines,
                                                   const std::string& node, const ros::Time& stamp);

/// When a node reports: two seconds after its start, and until all is well again whenever the
/// levels have changed, at ever longer intervals and a bounded number of times.
class ReportSchedule {
 public:
  static constexpr double kFirst_s = 2.0;
  static constexpr int kMostReports = 10;

  /// True if these lines are to be reported now; counts as done then. \param age_s time since the
  /// start, never less than at the last call.
  bool due(double age_s, const std::vector<DoctorLine>& lines);

 private:
  std::vector<DoctorLevel> last_levels_;
  double next_s_ = kFirst_s;
  double pause_s_ = kFirst_s;
  int num_reports_ = 0;
  bool settled_ = false;
};

}  // namespace point_line_odometry
