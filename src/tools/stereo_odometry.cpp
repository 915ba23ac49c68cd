#include "point_line_odometry/stereo_odometry.h"

/// The nodelet point_line_odometry/StereoOdometry as a node of its own.
#include "ros/stereo_odometry_nodelet.h"
#include "tools/nodelet_main.h"

int main(int argc, char** argv) {
  return point_line_odometry::runNodelet<point_line_odometry::StereoOdometryNodelet>(
      argc, argv, "stereo_odometry", "point_line_odometry/StereoOdometry");
}
