#include "tools/live_source.h"

#include "common/input_error.h"

namespace point_line_odometry {

void initLive(const char* /*node_name*/, int* /*argc*/, char** /*argv*/) {}

std::unique_ptr<StereoSource> openLive(const LiveOptions& /*options*/) {
  throw InputError(
      "'live' cannot be read: this program was built without ROS; name a folder or "
      "synthetic:SCENE, or build the package with catkin");
}

}  // namespace point_line_odometry
