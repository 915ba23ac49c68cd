#pragma once

#include <array>
#include <string>
#include <vector>

namespace point_line_odometry {

/// A parameter of the core that there is no longer. Whoever still names it is warned until
/// the next major version, and the value given is ignored.
struct RetiredParameter {
  const char* name;
  int value;           ///< that holds instead
  const char* since;   ///< the first version without it
  const char* reason;  ///< why it went
};

/// The one table of them. A name goes from here with the major version after `since`.
inline constexpr std::array<RetiredParameter, 2> kRetiredParameters{{
    {"motion/max_iterations", 20, "1.0.0", "more iterations give the same motion"},
    {"window/max_iterations", 5, "1.0.0", "more iterations give the same errors"},
}};

/// Whether a parameter of this name was retired. If so, adds a warning that names it, unless it is
/// there already. \param warnings null: not wanted.
bool isRetired(const std::string& name, std::vector<std::string>* warnings);

}  // namespace point_line_odometry
