#pragma once

namespace point_line_odometry {

/// The version of the library, as in package.xml: "MAJOR.MINOR.PATCH", by the rules of semantic
/// versioning. CONTRIBUTING.md says what the numbers promise.
const char* version();

}  // namespace point_line_odometry
