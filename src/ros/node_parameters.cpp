#include "ros/node_parameters.h"

#include "odometry/parameter_checker.h"
#include "ros/parameter_tree.h"

namespace point_line_odometry {
namespace {

struct NameCollector {
  std::vector<std::string> names;

  template <typename... Rest>
  void operator()(const char* name, const Rest&...) {
    names.emplace_back(name);
  }
};

}  // namespace

std::vector<std::string> nodeParameterNames() {
  NameCollector collector;
  const NodeParameters defaults;
  visitNodeParameters(defaults, collector);
  return collector.names;
}

std::vector<std::string> checkNodeParameters(const NodeParameters& parameters) {
  ParameterChecker checker;
  visitNodeParameters(parameters, checker);
  if (parameters.odom_frame_id == parameters.base_frame_id) {
    checker.errors.emplace_back("odom_frame_id and base_frame_id are the same, but must differ");
  }
  return checker.errors;
}

Eigen::Isometry3d initialPose(const NodeParameters& parameters) {
  const auto& pose = parameters.initial_pose;
  Eigen::Isometry3d T_odom_base = Eigen::Isometry3d::Identity();
  T_odom_base.linear() = (Eigen::AngleAxisd(pose.yaw, Eigen::Vector3d::UnitZ()) *
                          Eigen::AngleAxisd(pose.pitch, Eigen::Vector3d::UnitY()) *
                          Eigen::AngleAxisd(pose.roll, Eigen::Vector3d::UnitX()))
                             .toRotationMatrix();
  T_odom_base.translation() = Eigen::Vector3d(pose.x, pose.y, pose.z);
  return T_odom_base;
}

AllParameters parseParameters(const XmlRpc::XmlRpcValue& tree) {
  AllParameters parameters;
  ParameterTree values(tree);
  visitNodeParameters(parameters.node, values);
  visitParameters(parameters.core, values);
  values.ignoreSection(parameters.node.image_transport);  // the transport's own
  std::vector<std::string> errors = values.errors();
  for (const auto& more :
       {checkNodeParameters(parameters.node), checkParameters(parameters.core)}) {
    errors.insert(errors.end(), more.begin(), more.end());
  }
  requireNoParameterErrors(errors);
  return parameters;
}

AllParameters loadNodeParameters(const ros::NodeHandle& private_nh) {
  return parseParameters(readPrivateParameters(private_nh));
}

}  // namespace point_line_odometry
