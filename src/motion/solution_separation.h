#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Finds the part of the left image that determines an axis of the motion against all others. Its
/// matches may be wrong together, as points where the upright edge of a near wall crosses a level
/// edge of a far one: they have the depth of the one and follow the rows of the other, agree with
/// each other, and leave no residuals in the motion that they cause. The test is that of solution
/// separation (Brown and McBurney, "Self-contained GPS integrity check using maximum solution
/// separation", Navigation, 1988): how far the estimate moves without them.
class SolutionSeparation {
 public:
  explicit SolutionSeparation(const StereoCamera& camera);

  /// Adds a match at a pixel of the left image. \param information J^T W J and \param gradient
  /// J^T W r at the estimate, of a perturbation of the motion.
  void add(const Eigen::Vector2d& left_px, const Matrix6d& information, const Vector6d& gradient);

  /// Adds information about the perturbation that does not come from matches.
  void addPrior(const Matrix6d& information) { whole_.information += information; }

  /// The part whose matches are at most a third of all and have the leverage of an axis, and
  /// without which the estimate moves most, in standard deviations of the estimate by the others;
  /// nothing if that may be chance.
  std::optional<Eigen::AlignedBox2d> mostSeparated() const;

 private:
  /// Sums over the matches in a cell, or a part.
  struct Sums {
    Matrix6d information = Matrix6d::Zero();
    Vector6d gradient = Vector6d::Zero();
    int num_matches = 0;

    Sums& operator+=(const Sums& other);
  };

  /// Squared length of the step of the estimate without a part; 0 for a part that is not
  /// suspected.
  double separation(const Sums& part) const;

  Sums sumOf(const Eigen::AlignedBox2i& cells) const;

  double cell_px_;
  Eigen::Vector2i size_;     // cells in a row and in a column
  std::vector<Sums> cells_;  // row by row
  Sums whole_;
};

}  // namespace point_line_odometry
