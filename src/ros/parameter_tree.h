#pragma once

#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <map>
#include <string>
#include <vector>

namespace point_line_odometry {

/// Visitor of parameter tables that sets what a struct of private parameters (nested as the names'
/// paths) holds, and collects errors.
class ParameterTree {
 public:
  explicit ParameterTree(XmlRpc::XmlRpcValue tree);

  template <typename T, typename... Rest>
  void operator()(const char* name, T& value, const Rest&...) {
    const auto leaf = leaves_.find(name);
    if (leaf == leaves_.end()) return;
    read(name, leaf->second, value);
    leaves_.erase(leaf);
  }

  /// Names that begin with this and a slash are not checked.
  void ignoreSection(const std::string& section);

  /// Passes over the names of retired parameters. \return a warning for each.
  std::vector<std::string> ignoreRetired();

  /// One sentence for each value of a wrong type and each name that none of the visited tables had;
  /// empty if all are fine. Names that libraries of the node use are accepted.
  std::vector<std::string> errors() const;

 private:
  using Leaves = std::map<std::string, XmlRpc::XmlRpcValue>;

  static Leaves flatten(XmlRpc::XmlRpcValue& tree, const std::string& prefix = "");
  void read(const char* name, XmlRpc::XmlRpcValue& leaf, bool& value);
  void read(const char* name, XmlRpc::XmlRpcValue& leaf, int& value);
  void read(const char* name, XmlRpc::XmlRpcValue& leaf, double& value);
  void read(const char* name, XmlRpc::XmlRpcValue& leaf, std::string& value);
  bool expect(const char* name, bool right_type, const char* wanted);

  Leaves leaves_;
  std::vector<std::string> errors_;
};

/// Everything under the private node handle on the parameter server.
XmlRpc::XmlRpcValue readPrivateParameters(const ros::NodeHandle& private_nh);

/// Throws std::runtime_error with one sentence of all errors, if there are any.
void requireNoParameterErrors(const std::vector<std::string>& errors);

}  // namespace point_line_odometry
