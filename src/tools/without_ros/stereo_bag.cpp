#include "tools/stereo_bag.h"

#include "common/input_error.h"

namespace point_line_odometry {

void writeStereoBag(StereoSource& /*source*/, const StereoBagOptions& options) {
  throw InputError("bag '" + options.file +
                   "' cannot be written: this program was built without ROS, which writes bags; "
                   "name a folder, or build the package with catkin");
}

}  // namespace point_line_odometry
