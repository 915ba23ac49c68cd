#include "ros/doctor_report.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <sstream>

#include "common/join.h"

namespace point_line_odometry {
namespace {

using Level = DoctorLevel;
using Subject = DoctorSubject;

int countLevel(const std::vector<DoctorLine>& lines, Level level) {
  return static_cast<int>(std::count_if(lines.begin(), lines.end(),
                                        [level](const auto& line) { return line.level == level; }));
}

std::uint8_t toStatusLevel(Level level) {
  using Status = diagnostic_msgs::DiagnosticStatus;
  switch (level) {
    case Level::kOk:
      return Status::OK;
    case Level::kUnknown:
      return Status::STALE;
    case Level::kWarn:
      return Status::WARN;
    case Level::kError:
      break;
  }
  return Status::ERROR;
}

}  // namespace

const char* toString(DoctorLevel level) {
  switch (level) {
    case Level::kOk:
      return "ok";
    case Level::kUnknown:
      return "?";
    case Level::kWarn:
      return "WARN";
    case Level::kError:
      break;
  }
  return "ERROR";
}

const char* toString(DoctorSubject subject) {
  switch (subject) {
    case Subject::kLeftImage:
      return "left image";
    case Subject::kRightImage:
      return "right image";
    case Subject::kLeftInfo:
      return "left camera_info";
    case Subject::kRightInfo:
      return "right camera_info";
    case Subject::kStamps:
      return "stamps";
    case Subject::kImages:
      return "images";
    case Subject::kCalibration:
      return "calibration";
    case Subject::kBaseline:
      return "baseline";
    case Subject::kRectification:
      return "rectification";
    case Subject::kDisparity:
      return "disparity";
    case Subject::kTrigger:
      return "trigger";
    case Subject::kShutter:
      return "shutter";
    case Subject::kProjector:
      return "projector";
    case Subject::kMounting:
      return "tf";
    case Subject::kMasks:
      return "masks";
    case Subject::kImu:
      return "imu";
    case Subject::kWheels:
      return "wheels";
    case Subject::kSpeed:
      return "speed";
    case Subject::kClock:
      break;
  }
  return "clock";
}

DoctorLevel worstLevel(const std::vector<DoctorLine>& lines) {
  Level worst = Level::kOk;
  for (const DoctorLine& line : lines) worst = std::max(worst, line.level);
  return worst;
}

std::string summarize(const std::vector<DoctorLine>& lines) {
  const int errors = countLevel(lines, Level::kError);
  const int warnings = countLevel(lines, Level::kWarn);
  const int unknowns = countLevel(lines, Level::kUnknown);
  std::vector<std::string> parts;
  if (errors > 0) parts.push_back(std::to_string(errors) + (errors == 1 ? " error" : " errors"));
  if (warnings > 0) {
    parts.push_back(std::to_string(warnings) + (warnings == 1 ? " warning" : " warnings"));
  }
  if (unknowns > 0) parts.push_back(std::to_string(unknowns) + " not known yet");
  return parts.empty() ? "all is well" : join(parts, ", ");
}

std::string formatReport(const std::vector<DoctorLine>& lines) {
  std::ostringstream text;
  for (const DoctorLine& line : lines) {
    std::array<char, 64> head{};
    std::snprintf(head.data(), head.size(), "%-5s  %-17s  ", toString(line.level),
                  toString(line.subject));
    text << head.data() << line.text << '\n';
    if (!line.hint.empty()) text << std::string(26, ' ') << "-> " << line.hint << '\n';
  }
  return text.str();
}

diagnostic_msgs::DiagnosticArray toDiagnosticArray(const std::vector<DoctorLine>& lines,
                                                   const std::string& node,
                                                   const ros::Time& stamp) {
  diagnostic_msgs::DiagnosticArray array;
  array.header.stamp = stamp;
  const auto value = [](const std::string& key, const std::string& text) {
    diagnostic_msgs::KeyValue pair;
    pair.key = key;
    pair.value = text;
    return pair;
  };
  for (const DoctorLine& line : lines) {
    diagnostic_msgs::DiagnosticStatus status;
    status.level = toStatusLevel(line.level);
    status.name = node + ": " + toString(line.subject);
    status.hardware_id = "stereo camera";
    status.message = line.hint.empty() ? line.text : line.text + "; " + line.hint;
    if (!line.hint.empty()) status.values.push_back(value("hint", line.hint));
    for (const auto& [key, text] : line.values) status.values.push_back(value(key, text));
    array.status.push_back(status);
  }
  return array;
}

bool ReportSchedule::due(double age_s, const std::vector<DoctorLine>& lines) {
  if (settled_ || num_reports_ >= kMostReports || age_s < next_s_) return false;
  std::vector<Level> levels;
  levels.reserve(lines.size());
  for (const DoctorLine& line : lines) levels.push_back(line.level);
  if (levels == last_levels_) return false;
  last_levels_ = std::move(levels);
  next_s_ = age_s + pause_s_;
  pause_s_ *= 2.0;
  ++num_reports_;
  settled_ = worstLevel(lines) == Level::kOk;
  return true;
}

}  // namespace point_line_odometry
