#pragma once

#include <cstdint>
#include <iomanip>
#include <locale>
#include <ostream>
#include <sstream>

namespace point_line_odometry {

/// A stream that formats numbers independently of the user's locale.
inline std::ostringstream classicStream() {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  return text;
}

/// Writes a stamp in seconds with all of its nanoseconds.
inline void writeStamp(std::ostream& out, std::int64_t stamp_ns) {
  constexpr std::int64_t kNanosecondsPerSecond = 1000000000;
  out << stamp_ns / kNanosecondsPerSecond << '.' << std::setw(9) << std::setfill('0')
      << stamp_ns % kNanosecondsPerSecond;
}

}  // namespace point_line_odometry
