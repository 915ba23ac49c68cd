#pragma once

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>
#include <vector>

#include "common/join.h"

namespace point_line_odometry {

/// Visitor of a parameter table that collects one sentence for each value that is not allowed.
struct ParameterChecker {
  std::vector<std::string> errors;

  void operator()(const char*, bool, const char*) {}

  void operator()(const char* name, const std::string& value, const char*) {
    if (value.empty()) errors.push_back(std::string(name) + " is empty, but must be a name");
  }

  template <typename T>
  void operator()(const char* name, T value, T minimum, T maximum, const char* unit, const char*) {
    if (std::isfinite(static_cast<double>(value)) && value >= minimum && value <= maximum) return;
    std::ostringstream text;
    text << name << " is " << value << ", but must lie in [" << minimum << ", " << maximum << "]"
         << (*unit ? " " : "") << unit;
    errors.push_back(text.str());
  }

  void operator()(const char* name, const std::string& value,
                  const std::vector<std::string>& choices, const char*) {
    if (std::find(choices.begin(), choices.end(), value) != choices.end()) return;
    errors.push_back(std::string(name) + " is '" + value +
                     "', but must be one of: " + join(choices, ", "));
  }
};

}  // namespace point_line_odometry
