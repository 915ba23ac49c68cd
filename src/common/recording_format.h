#pragma once

namespace point_line_odometry {

/// Number of the format of a recording's yaml. It rises when a reader would take a new yaml for
/// something else; a new field that a reader may leave out does not raise it. Version 0.1.0 wrote
/// none, which is the same as 1.
constexpr int kRecordingFormat = 1;

}  // namespace point_line_odometry
