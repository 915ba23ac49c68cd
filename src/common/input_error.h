#pragma once

#include <stdexcept>

namespace point_line_odometry {

/// Unusable input of a user; what() is one sentence that names it and what to do.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace point_line_odometry
