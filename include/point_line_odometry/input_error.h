#pragma once

#include <stdexcept>

namespace point_line_odometry {

/// Input that a user gave and that cannot be used; what() is one sentence that names the thing and
/// the cure.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace point_line_odometry
