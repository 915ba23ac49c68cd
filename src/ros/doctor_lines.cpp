#include "ros/doctor_lines.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>

namespace point_line_odometry {

std::string number(double value, int decimals) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
  return text.data();
}

std::string milliseconds(double seconds) {
  return number(1e3 * seconds, std::abs(seconds) < 0.1 ? 1 : 0) + " ms";
}

DoctorLine okLine(DoctorSubject subject, const std::string& text) {
  return {subject, DoctorLevel::kOk, text, {}, {}};
}

DoctorLine unknownLine(DoctorSubject subject, const std::string& text) {
  return {subject, DoctorLevel::kUnknown, text, {}, {}};
}

DoctorLine failureLine(DoctorSubject subject, DoctorLevel level, const std::string& text,
                       const std::string& hint) {
  return {subject, level, text, hint, {}};
}

DoctorLine failureLine(DoctorSubject subject, const std::string& sentence) {
  std::size_t at = sentence.rfind("; ");
  if (at == std::string::npos) at = sentence.rfind(": ");
  if (at == std::string::npos)
    return failureLine(subject, DoctorLevel::kError, sentence, "see above");
  return failureLine(subject, DoctorLevel::kError, sentence.substr(0, at), sentence.substr(at + 2));
}

}  // namespace point_line_odometry
