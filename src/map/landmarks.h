#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "features/features.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/residuals.h"

namespace point_line_odometry {

/// Gaussian estimate of a position: its mean `value`, and a square root of its covariance,
/// covariance = sqrt_covariance * sqrt_covariance^T. A point has three coordinates and degrees of
/// freedom. A line has six coordinates, its end points, and four degrees of freedom: each end point
/// moves in two directions normal to the line. These correspond to the four of the orthonormal
/// representation (Bartoli and Sturm 2005), in metres near the segment instead of near the origin.
template <int kSize, int kDof>
struct GaussianEstimate {
  static constexpr int kNumDof = kDof;
  using Value = Eigen::Matrix<double, kSize, 1>;
  using SqrtCovariance = Eigen::Matrix<double, kSize, kDof>;

  Value value = Value::Zero();
  SqrtCovariance sqrt_covariance = SqrtCovariance::Zero();

  Eigen::Matrix<double, kSize, kSize> covariance() const {
    return sqrt_covariance * sqrt_covariance.transpose();
  }

  /// Kalman update by a residual, its Jacobian by the value, and the covariance of its noise, in
  /// square-root form: J = J_value S, S' = S L^-T with L L^T = I + J^T noise^-1 J. Returns false,
  /// and changes nothing, if the result is not finite.
  template <int kRows>
  bool update(const Eigen::Matrix<double, kRows, 1>& residual,
              const Eigen::Matrix<double, kRows, kSize>& J_value,
              const Eigen::Matrix<double, kRows, kRows>& noise) {
    const Eigen::Matrix<double, kRows, kDof> J = J_value * sqrt_covariance;
    const Eigen::LLT<Eigen::Matrix<double, kRows, kRows>> noise_root(noise);
    if (noise_root.info() != Eigen::Success) return false;
    const Eigen::Matrix<double, kRows, kDof> white_J = noise_root.matrixL().solve(J);
    const Eigen::Matrix<double, kRows, 1> white = noise_root.matrixL().solve(residual);
    Eigen::Matrix<double, kDof, kDof> information = white_J.transpose() * white_J;
    information.diagonal().array() += 1.0;
    const Eigen::LLT<Eigen::Matrix<double, kDof, kDof>> root(information);
    const Value step = -sqrt_covariance * root.solve(white_J.transpose() * white);
    const SqrtCovariance updated = root.matrixL().solve(sqrt_covariance.transpose()).transpose();
    if (!step.allFinite() || !updated.allFinite()) return false;
    value += step;
    sqrt_covariance = updated;
    return true;
  }
};

using PointEstimate = GaussianEstimate<3, 3>;
using LineEstimate = GaussianEstimate<6, 4>;  // start, end

inline PointCorrespondence correspondence(const PointEstimate& estimate,
                                          const PointObservation& observation) {
  PointCorrespondence point;
  static_cast<PointObservation&>(point) = observation;
  point.p_prev = estimate.value;
  return point;
}

inline LineCorrespondence correspondence(const LineEstimate& estimate,
                                         const LineObservation& observation) {
  LineCorrespondence line;
  static_cast<LineObservation&>(line) = observation;
  line.start_prev = estimate.value.head<3>();
  line.end_prev = estimate.value.tail<3>();
  return line;
}

/// How often a landmark was observed.
struct TrackStatistics {
  int seen = 1;                     ///< frames that observed it
  int missed = 0;                   ///< frames since the last observation with it in view
  std::uint64_t last_keyframe = 0;  ///< the last that observed it, or the next after it was created
};

/// A point landmark: its position in the map, and its appearance.
struct MapPoint {
  static constexpr int kPatchSide = 23;
  static constexpr int kHalfPatch = kPatchSide / 2;

  std::uint64_t id = 0;
  PointEstimate estimate;  ///< in the map [m]
  TrackStatistics statistics;
  int octave = 0;  ///< pyramid level of its patch
  /// Jacobian of the point on its surface by its pixel in the left image that it was created from,
  /// in the map [m / px].
  PixelAxes patch_axes = PixelAxes::Zero();
  std::array<std::uint8_t, kPatchSide * kPatchSide> patch{};  ///< from that image, in its octave
  Descriptor left{};
  Descriptor right{};
};

/// A line landmark: its position in the map, and its descriptors.
struct MapLine {
  std::uint64_t id = 0;
  LineEstimate estimate;  ///< in the map [m]
  TrackStatistics statistics;
  Descriptor left{};
  Descriptor right{};
};

}  // namespace point_line_odometry
