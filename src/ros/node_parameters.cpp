#include "ros/node_parameters.h"

#include <ros/param.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <stdexcept>

#include "odometry/parameter_checker.h"

namespace point_line_odometry {
namespace {

using XmlRpc::XmlRpcValue;

struct NameCollector {
  std::vector<std::string> names;

  template <typename... Rest>
  void operator()(const char* name, const Rest&...) {
    names.emplace_back(name);
  }
};

using Leaves = std::map<std::string, XmlRpcValue>;

/// "a/b/c" -> value for the leaves of nested structs.
Leaves flatten(XmlRpcValue& tree, const std::string& prefix = "") {
  Leaves leaves;
  if (tree.getType() != XmlRpcValue::TypeStruct) return leaves;
  for (auto& entry : tree) {
    const std::string name = prefix + entry.first;
    if (entry.second.getType() == XmlRpcValue::TypeStruct) {
      const Leaves inner = flatten(entry.second, name + "/");
      leaves.insert(inner.begin(), inner.end());
    } else {
      leaves.emplace(name, entry.second);
    }
  }
  return leaves;
}

/// Takes the values of known names out of the leaves; what stays there is unknown.
struct LeafReader {
  Leaves& leaves;
  std::vector<std::string> errors;

  template <typename T, typename... Rest>
  void operator()(const char* name, T& value, const Rest&...) {
    const auto leaf = leaves.find(name);
    if (leaf == leaves.end()) return;
    read(name, leaf->second, value);
    leaves.erase(leaf);
  }

 private:
  void read(const char* name, XmlRpcValue& leaf, bool& value) {
    if (expect(name, leaf.getType() == XmlRpcValue::TypeBoolean, "true or false")) value = leaf;
  }

  void read(const char* name, XmlRpcValue& leaf, int& value) {
    if (expect(name, leaf.getType() == XmlRpcValue::TypeInt, "a whole number")) value = leaf;
  }

  void read(const char* name, XmlRpcValue& leaf, double& value) {
    if (leaf.getType() == XmlRpcValue::TypeInt) {
      value = static_cast<int>(leaf);
    } else if (expect(name, leaf.getType() == XmlRpcValue::TypeDouble, "a number")) {
      value = leaf;
    }
  }

  void read(const char* name, XmlRpcValue& leaf, std::string& value) {
    if (!expect(name, leaf.getType() == XmlRpcValue::TypeString, "a text")) return;
    value = static_cast<std::string>(leaf);
  }

  bool expect(const char* name, bool right_type, const char* wanted) {
    if (!right_type) errors.push_back(std::string(name) + " must be " + wanted);
    return right_type;
  }
};

/// Private parameters that the nodelet library, image transports and diagnostics look up on their
/// own.
bool belongsToLibraries(const std::string& name) {
  const std::string first = name.substr(0, name.find('/'));
  const auto is = [&](const char* word) { return first == word; };
  return is("num_worker_threads") || is("diagnostic_period") || is("compressed") ||
         is("compressedDepth") || is("theora");
}

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

AllParameters parseParameters(XmlRpc::XmlRpcValue tree) {
  AllParameters parameters;
  Leaves leaves = flatten(tree);
  LeafReader reader{leaves, {}};
  visitNodeParameters(parameters.node, reader);
  visitParameters(parameters.core, reader);

  std::vector<std::string> errors = reader.errors;
  for (const auto& leaf : leaves) {
    if (!belongsToLibraries(leaf.first)) errors.push_back("unknown parameter ~" + leaf.first);
  }
  const auto append = [&errors](const std::vector<std::string>& more) {
    errors.insert(errors.end(), more.begin(), more.end());
  };
  append(checkNodeParameters(parameters.node));
  append(checkParameters(parameters.core));
  if (!errors.empty()) {
    throw std::runtime_error("parameters cannot be used: " + join(errors, "; "));
  }
  return parameters;
}

AllParameters loadNodeParameters(const ros::NodeHandle& private_nh) {
  XmlRpc::XmlRpcValue tree;
  ros::param::get(private_nh.getNamespace(), tree);
  return parseParameters(tree);
}

}  // namespace point_line_odometry
