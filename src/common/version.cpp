#include "point_line_odometry/version.h"

namespace point_line_odometry {

const char* version() { return POINT_LINE_ODOMETRY_VERSION; }

}  // namespace point_line_odometry
