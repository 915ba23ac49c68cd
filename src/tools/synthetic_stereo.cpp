#include "ros/synthetic_stereo_nodelet.h"
#include "tools/nodelet_main.h"

/// The nodelet point_line_odometry/SyntheticStereo as a node of its own.
int main(int argc, char** argv) {
  return point_line_odometry::runNodelet<point_line_odometry::SyntheticStereoNodelet>(
      argc, argv, "synthetic_stereo", "point_line_odometry/SyntheticStereo");
}
