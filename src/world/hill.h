#pragma once

#include <Eigen/Core>

namespace point_line_odometry::world {

class Random;
struct Scene;

/// A hill that does not depend on y: half a wave of a cosine, and flat before and behind it.
struct Hill {
  double height_m = 0.0;  ///< 0: there is none
  double middle_x = 0.0;
  double half_length_m = 75.0;

  /// Height of the ground at x [m].
  double heightAt(double x) const;
};

/// Dashes in the middle of the road [m]: periodic, so that their matches are ambiguous.
struct LaneDashes {
  static constexpr double kPeriod_m = 7.5;
  static constexpr double kLength_m = 3.0;
  static constexpr double kWidth_m = 0.12;
};

/// Adds the ground of a hill over a range of x: a road along y = 0 with dashes in its
/// middle, verges of short grass, and slopes down to the plain at their sides.
void addHill(const Hill& hill, const Eigen::Vector2d& range_x, double road_width_m, Random* random,
             Scene* scene);

}  // namespace point_line_odometry::world
