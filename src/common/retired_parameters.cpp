#include "common/retired_parameters.h"

#include <algorithm>

namespace point_line_odometry {

bool isRetired(const std::string& name, std::vector<std::string>* warnings) {
  for (const RetiredParameter& retired : kRetiredParameters) {
    if (name != retired.name) continue;
    const std::string warning = "parameter " + name + " is ignored: since version " +
                                retired.since + " it is always " + std::to_string(retired.value) +
                                ", as " + retired.reason;
    if (warnings != nullptr && std::count(warnings->begin(), warnings->end(), warning) == 0)
      warnings->push_back(warning);
    return true;
  }
  return false;
}

}  // namespace point_line_odometry
