#include "ros/parameter_tree.h"

#include <ros/param.h>

#include <iterator>
#include <stdexcept>

#include "common/join.h"
#include "common/retired_parameters.h"

namespace point_line_odometry {
namespace {

using XmlRpc::XmlRpcValue;

/// Private parameters that the nodelet library, image transports and diagnostics look up on their
/// own.
bool belongsToLibraries(const std::string& name) {
  const std::string first = name.substr(0, name.find('/'));
  const auto is = [&](const char* word) { return first == word; };
  return is("num_worker_threads") || is("diagnostic_period") || is("compressed") ||
         is("compressedDepth") || is("theora");
}

}  // namespace

ParameterTree::ParameterTree(XmlRpcValue tree) : leaves_(flatten(tree)) {}

/// "a/b/c" -> value for the leaves of nested structs.
ParameterTree::Leaves ParameterTree::flatten(XmlRpcValue& tree, const std::string& prefix) {
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

void ParameterTree::read(const char* name, XmlRpcValue& leaf, bool& value) {
  if (expect(name, leaf.getType() == XmlRpcValue::TypeBoolean, "true or false")) value = leaf;
}

void ParameterTree::read(const char* name, XmlRpcValue& leaf, int& value) {
  if (expect(name, leaf.getType() == XmlRpcValue::TypeInt, "a whole number")) value = leaf;
}

void ParameterTree::read(const char* name, XmlRpcValue& leaf, double& value) {
  if (leaf.getType() == XmlRpcValue::TypeInt) {
    value = static_cast<int>(leaf);
  } else if (expect(name, leaf.getType() == XmlRpcValue::TypeDouble, "a number")) {
    value = leaf;
  }
}

void ParameterTree::read(const char* name, XmlRpcValue& leaf, std::string& value) {
  if (!expect(name, leaf.getType() == XmlRpcValue::TypeString, "a text")) return;
  value = static_cast<std::string>(leaf);
}

bool ParameterTree::expect(const char* name, bool right_type, const char* wanted) {
  if (!right_type) errors_.push_back(std::string(name) + " must be " + wanted);
  return right_type;
}

void ParameterTree::ignoreSection(const std::string& section) {
  for (auto leaf = leaves_.begin(); leaf != leaves_.end();)
    leaf = leaf->first.rfind(section + "/", 0) == 0 ? leaves_.erase(leaf) : std::next(leaf);
}

std::vector<std::string> ParameterTree::ignoreRetired() {
  std::vector<std::string> warnings;
  for (auto leaf = leaves_.begin(); leaf != leaves_.end();)
    leaf = isRetired(leaf->first, &warnings) ? leaves_.erase(leaf) : std::next(leaf);
  return warnings;
}

std::vector<std::string> ParameterTree::errors() const {
  std::vector<std::string> errors = errors_;
  for (const auto& leaf : leaves_) {
    if (!belongsToLibraries(leaf.first)) errors.push_back("unknown parameter ~" + leaf.first);
  }
  return errors;
}

XmlRpcValue readPrivateParameters(const ros::NodeHandle& private_nh) {
  XmlRpcValue tree;
  ros::param::get(private_nh.getNamespace(), tree);
  return tree;
}

void requireNoParameterErrors(const std::vector<std::string>& errors) {
  if (errors.empty()) return;
  throw std::runtime_error("parameters cannot be used: " + join(errors, "; "));
}

}  // namespace point_line_odometry
