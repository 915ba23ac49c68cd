#pragma once

#include <nodelet/loader.h>
#include <ros/init.h>
#include <ros/names.h>
#include <ros/this_node.h>

#include <boost/function.hpp>
#include <boost/make_shared.hpp>
#include <string>
#include <vector>

namespace point_line_odometry {

/// main() of a nodelet as a node of its own. Returns 2 if it does not start; it has then logged
/// why.
template <typename NodeletType>
int runNodelet(int argc, char** argv, const std::string& name, const std::string& type) {
  ros::init(argc, argv, name);
  const boost::function<boost::shared_ptr<nodelet::Nodelet>(const std::string&)> create =
      [](const std::string&) { return boost::make_shared<NodeletType>(); };
  nodelet::Loader loader(create);
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  if (!loader.load(ros::this_node::getName(), type, ros::names::getRemappings(), arguments)) {
    return 2;
  }
  ros::spin();
  return 0;
}

}  // namespace point_line_odometry
