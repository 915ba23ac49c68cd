#pragma once

#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

#include "ros/node_parameters.h"

namespace point_line_odometry {

/// Sets what `tree` (the struct of private parameters, nested as their paths) names. Throws
/// std::runtime_error with one sentence that names every unknown name, wrong type and value out of
/// range. \param warnings gets a sentence for each retired parameter that is named; null: not
/// wanted.
AllParameters parseParameters(const XmlRpc::XmlRpcValue& tree,
                              std::vector<std::string>* warnings = nullptr);

/// parseParameters() of everything under the private node handle on the parameter server; its
/// warnings go to the log.
AllParameters loadNodeParameters(const ros::NodeHandle& private_nh);

}  // namespace point_line_odometry
