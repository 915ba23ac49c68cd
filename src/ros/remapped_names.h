#pragma once

#include <ros/forwards.h>
#include <ros/node_handle.h>

#include <string>

namespace point_line_odometry {

/// \file
/// Which topics a running node takes under the names that it subscribes to: for tools that take the
/// same input, as ROS does not tell the remappings of another node. The node keeps them in its
/// private parameters remappings/left_image_rect, ...

/// The section of the private parameters.
constexpr const char* kRemappingsSection = "remappings";

/// Sets them; those of a node that ran before are removed.
void publishRemappings(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);

/// The name by which an image topic is subscribed to with a transport of image_transport. Names are
/// remapped when they are subscribed to, except by the transports that add to them: for these it is
/// done here. A name must not be remapped twice, which would undo an exchange of left and right.
std::string nameForTransport(const ros::NodeHandle& nh, const std::string& name,
                             const std::string& transport);

/// Those of a node, for a node handle in its namespace; none if there is no such node.
/// \param private_nh the node's.
ros::M_string loadRemappings(const ros::NodeHandle& private_nh);

}  // namespace point_line_odometry
