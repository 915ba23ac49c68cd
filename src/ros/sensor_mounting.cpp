#include "ros/sensor_mounting.h"

#include "ros/conversions.h"

namespace point_line_odometry {

void SensorMounting::prepare(const std::string& frame_id) {
  const std::string sensor = withoutLeadingSlash(frame_id);
  const bool needed = !known_ || (known_->sensor != sensor && other_sensor_.awaits(sensor));
  if (needed) known_ = Known{sensor, lookup_(sensor)};
}

const Eigen::Isometry3d& SensorMounting::take(const std::string& frame_id) {
  const std::string sensor = withoutLeadingSlash(frame_id);
  if (!known_ || known_->sensor != sensor) {
    other_sensor_.add(sensor);
    throw MessageError(source_ + ": frame_id is '" + sensor + "' instead of '" +
                       (known_ ? known_->sensor : std::string()) + "'; it is accepted once " +
                       std::to_string(kConfirmations) + " messages in a row have it");
  }
  other_sensor_.clear();
  return known_->T_base_header;
}

}  // namespace point_line_odometry
