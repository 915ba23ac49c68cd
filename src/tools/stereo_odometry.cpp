#include <nodelet/loader.h>
#include <ros/init.h>
#include <ros/names.h>
#include <ros/this_node.h>

#include <boost/function.hpp>
#include <boost/make_shared.hpp>
#include <string>
#include <vector>

#include "ros/stereo_odometry_nodelet.h"

/// The nodelet point_line_odometry/StereoOdometry as a node of its own.
int main(int argc, char** argv) {
  ros::init(argc, argv, "stereo_odometry");
  const boost::function<boost::shared_ptr<nodelet::Nodelet>(const std::string&)> create =
      [](const std::string&) {
        return boost::make_shared<point_line_odometry::StereoOdometryNodelet>();
      };
  nodelet::Loader loader(create);
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  const bool loaded = loader.load(ros::this_node::getName(), "point_line_odometry/StereoOdometry",
                                  ros::names::getRemappings(), arguments);
  if (!loaded) return 1;
  ros::spin();
  return 0;
}
