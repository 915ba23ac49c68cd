#include "ros/parameter_loader.h"

#include <ros/console.h>

#include <string>
#include <vector>

#include "ros/parameter_tree.h"
#include "ros/remapped_names.h"

namespace point_line_odometry {

AllParameters parseParameters(const XmlRpc::XmlRpcValue& tree, std::vector<std::string>* warnings) {
  AllParameters parameters;
  ParameterTree values(tree);
  visitNodeParameters(parameters.node, values);
  visitParameters(parameters.core, values);
  values.ignoreSection(parameters.node.image_transport);  // the transport's own
  values.ignoreSection(kRemappingsSection);               // of a node that ran before
  const std::vector<std::string> retired = values.ignoreRetired();
  if (warnings != nullptr) *warnings = retired;
  std::vector<std::string> errors = values.errors();
  for (const auto& more :
       {checkNodeParameters(parameters.node), checkParameters(parameters.core)}) {
    errors.insert(errors.end(), more.begin(), more.end());
  }
  requireNoParameterErrors(errors);
  return parameters;
}

AllParameters loadNodeParameters(const ros::NodeHandle& private_nh) {
  std::vector<std::string> warnings;
  const AllParameters parameters = parseParameters(readPrivateParameters(private_nh), &warnings);
  for (const std::string& warning : warnings) ROS_WARN("%s", warning.c_str());
  return parameters;
}

}  // namespace point_line_odometry
