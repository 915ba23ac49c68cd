#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "motion/residuals.h"
#include "point_line_odometry/matching.h"
#include "point_line_odometry/motion.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Gaussian belief about where something is: `value` is its mean, and the columns of `spread` are
/// its independent standard deviations: covariance = spread * spread^T. A point has three numbers
/// and as many freedoms. A line has six, its ends, and four freedoms: each end moves across the
/// line in two directions. These are the four of the orthonormal representation, in metres and near
/// the segment instead of near the origin.
template <int kSize, int kFreedoms>
struct Belief {
  static constexpr int kNumFreedoms = kFreedoms;
  using Value = Eigen::Matrix<double, kSize, 1>;
  using Spread = Eigen::Matrix<double, kSize, kFreedoms>;

  Value value = Value::Zero();
  Spread spread = Spread::Zero();

  Eigen::Matrix<double, kSize, kSize> covariance() const { return spread * spread.transpose(); }

  /// Takes a measurement into account: a residual with its derivative by the value, and its
  /// covariance. Returns false, and changes nothing, if they are not finite.
  template <int kRows>
  bool update(const Eigen::Matrix<double, kRows, 1>& residual,
              const Eigen::Matrix<double, kRows, kSize>& by_value,
              const Eigen::Matrix<double, kRows, kRows>& noise) {
    const Eigen::Matrix<double, kRows, kFreedoms> J = by_value * spread;
    const Eigen::LLT<Eigen::Matrix<double, kRows, kRows>> noise_root(noise);
    if (noise_root.info() != Eigen::Success) return false;
    const Eigen::Matrix<double, kRows, kFreedoms> white_J = noise_root.matrixL().solve(J);
    const Eigen::Matrix<double, kRows, 1> white = noise_root.matrixL().solve(residual);
    Eigen::Matrix<double, kFreedoms, kFreedoms> information = white_J.transpose() * white_J;
    information.diagonal().array() += 1.0;
    const Eigen::LLT<Eigen::Matrix<double, kFreedoms, kFreedoms>> root(information);
    const Value step = -spread * root.solve(white_J.transpose() * white);
    const Spread narrowed = root.matrixL().solve(spread.transpose()).transpose();
    if (!step.allFinite() || !narrowed.allFinite()) return false;
    value += step;
    spread = narrowed;
    return true;
  }
};

using PointBelief = Belief<3, 3>;
using LineBelief = Belief<6, 4>;  // start, end

inline PointCorrespondence correspondence(const PointBelief& place, const PointSight& sight) {
  PointCorrespondence point;
  static_cast<PointSight&>(point) = sight;
  point.p_prev = place.value;
  return point;
}

inline LineCorrespondence correspondence(const LineBelief& place, const LineSight& sight) {
  LineCorrespondence line;
  static_cast<LineSight&>(line) = sight;
  line.start_prev = place.value.head<3>();
  line.end_prev = place.value.tail<3>();
  return line;
}

/// How often a landmark was found.
struct Sightings {
  int seen = 1;                     ///< frames that found it
  int missed = 0;                   ///< frames that should have seen it since, and did not
  std::uint64_t last_keyframe = 0;  ///< the newest that saw it, or came when it was new
};

/// A corner: its place in the map, and what it looks like.
struct MapPoint {
  static constexpr int kPatchSide = 23;

  std::uint64_t id = 0;
  PointBelief place;  ///< in the map [m]
  Sightings sightings;
  int octave = 0;  ///< of the images in which it is looked for
  /// Where one pixel of the left image that made it to the right, and one down, lead on the
  /// surface, in the map [m].
  PixelAxes patch_axes = PixelAxes::Zero();
  std::array<std::uint8_t, kPatchSide * kPatchSide> patch{};  ///< of that image, in its octave
  Descriptor left{};
  Descriptor right{};
};

/// A line: its place in the map, and what it looks like.
struct MapLine {
  std::uint64_t id = 0;
  LineBelief place;  ///< in the map [m]
  Sightings sightings;
  Descriptor left{};
  Descriptor right{};
};

}  // namespace point_line_odometry
