#pragma once

/// \file
/// The lines of a report on the input of the odometry, and how they are shown.

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/time.h>

#include <string>
#include <utility>
#include <vector>

namespace point_line_odometry {

enum class DoctorLevel { kOk, kUnknown, kWarn, kError };  ///< in the order of severity

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
  kTrigger,
  kShutter,
  kProjector,
  kMounting,
  kMasks,
  kImu,
  kWheels,
  kSpeed,
  kClock
};

const char* toString(DoctorSubject subject);

/// One line of the report.
struct DoctorLine {
  DoctorSubject subject = DoctorSubject::kLeftImage;
  DoctorLevel level = DoctorLevel::kOk;
  std::string text;
  std::string hint;  ///< empty for kOk and kUnknown, never for the others
  std::vector<std::pair<std::string, std::string>> values;  ///< what was measured, with units

  bool failed() const { return level >= DoctorLevel::kWarn; }
};

/// The most severe level of the lines, kOk for none.
DoctorLevel worstLevel(const std::vector<DoctorLine>& lines);

/// "2 errors, 1 warning, 3 not known yet", or "all is well".
std::string summarize(const std::vector<DoctorLine>& lines);

/// The report for a terminal: a row for each line, its hint below it.
std::string formatReport(const std::vector<DoctorLine>& lines);

/// One status per line, as rqt shows them; the hint is part of the message and one of the values.
diagnostic_msgs::DiagnosticArray toDiagnosticArray(const std::vector<DoctorLine>& lines,
                                                   const std::string& node, const ros::Time& stamp);

/// When a node reports: two seconds after its start, then whenever levels have changed until all is
/// well, at intervals that double and at most kMostReports times.
class ReportSchedule {
 public:
  static constexpr double kFirst_s = 2.0;
  static constexpr int kMostReports = 10;

  /// True if these lines are to be reported now; the caller then does so. \param age_s time since
  /// the start, never less than at the last call.
  bool due(double age_s, const std::vector<DoctorLine>& lines);

 private:
  std::vector<DoctorLevel> last_levels_;
  double next_s_ = kFirst_s;
  double pause_s_ = kFirst_s;
  int num_reports_ = 0;
  bool settled_ = false;
};

}  // namespace point_line_odometry
