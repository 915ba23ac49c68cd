#pragma once

#include <string>

namespace point_line_odometry {

/// Starts the script report_run, which is installed beside this program, on a folder of results and
/// waits for it. Returns why there is no report, as a sentence for the user; empty if there is one.
std::string makeReport(const std::string& folder);

}  // namespace point_line_odometry
