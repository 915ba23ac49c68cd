#include "tools/bag_source.h"

#include "common/input_error.h"

namespace point_line_odometry {

std::unique_ptr<StereoSource> openBag(const BagOptions& options) {
  throw InputError("'" + options.file +
                   "' is no folder, and this program was built without ROS, which reads bags: name "
                   "a folder or synthetic:SCENE, or build the package with catkin");
}

}  // namespace point_line_odometry
