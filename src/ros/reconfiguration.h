#pragma once

#include <dynamic_reconfigure/Config.h>
#include <dynamic_reconfigure/ConfigDescription.h>
#include <dynamic_reconfigure/server.h>
#include <ros/node_handle.h>

#include <boost/thread/recursive_mutex.hpp>
#include <cstdint>
#include <functional>

#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// The core's parameters as dynamic_reconfigure::Server needs them, generated from
/// visitParameters() instead of a .cfg file. Names are those of the table, and the sections before
/// their slashes are groups. Retired parameters are a group of their own: they have the value in
/// use, and a client that sets them is warned.
struct ReconfigurableParameters {
  Parameters values;

  // Names that the server dictates.
  // NOLINTBEGIN(bugprone-reserved-identifier,readability-identifier-naming)
  /// Reads the values on the parameter server; those that do not fit are left as they are.
  void __fromServer__(const ros::NodeHandle& private_nh);
  void __toServer__(const ros::NodeHandle& private_nh) const;
  /// Reads the values that the message has.
  void __fromMessage__(const dynamic_reconfigure::Config& message);
  void __toMessage__(dynamic_reconfigure::Config& message) const;
  /// Does nothing: values out of range are rejected.
  void __clamp__() const {}
  std::uint32_t __level__(const ReconfigurableParameters&) const { return 1; }
  static ReconfigurableParameters __getDefault__() { return {}; }
  static ReconfigurableParameters __getMin__();
  static ReconfigurableParameters __getMax__();
  static dynamic_reconfigure::ConfigDescription __getDescriptionMessage__();
  // NOLINTEND(bugprone-reserved-identifier,readability-identifier-naming)
};

/// Offers the core's parameters to dynamic_reconfigure. A change that is not valid, alone or
/// together with the rest, is rejected as a whole with a message in the log, and the server gets
/// the current values back.
class Reconfiguration {
 public:
  /// \param private_nh where the parameters are; its callback queue calls `apply`.
  /// \param in_force parameters that the node has started with.
  /// \param apply called with valid new parameters.
  Reconfiguration(const ros::NodeHandle& private_nh, const Parameters& in_force,
                  std::function<void(const Parameters&)> apply);

 private:
  void take(ReconfigurableParameters* wanted);

  Parameters in_force_;
  std::function<void(const Parameters&)> apply_;
  boost::recursive_mutex mutex_;  // held by the server during take()
  dynamic_reconfigure::Server<ReconfigurableParameters> server_;
};

}  // namespace point_line_odometry
