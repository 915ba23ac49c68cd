#include "ros/camera_mounting.h"

#include "ros/conversions.h"

namespace point_line_odometry {

void CameraMounting::prepare(const std::string& frame_id) {
  const std::string camera = withoutLeadingSlash(frame_id);
  const bool needed = !known_ || (known_->camera != camera && other_camera_.awaits(camera));
  if (needed) known_ = Known{camera, lookup_(camera)};
}

const Eigen::Isometry3d& CameraMounting::take(const std::string& frame_id) {
  const std::string camera = withoutLeadingSlash(frame_id);
  if (!known_ || known_->camera != camera) {
    other_camera_.add(camera);
    throw MessageError("left image: frame_id is '" + camera + "' instead of '" +
                       (known_ ? known_->camera : std::string()) + "'; it is taken once " +
                       std::to_string(kConfirmations) + " frames in a row have it");
  }
  other_camera_.clear();
  return known_->T_base_header;
}

}  // namespace point_line_odometry
