#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Where a stereo frame sees a point; the right pixel as a correctly calibrated camera would see
/// it.
struct PointSight {
  Eigen::Vector2d left_px = Eigen::Vector2d::Zero();
  Eigen::Vector2d right_px = Eigen::Vector2d::Zero();
  double sigma_px = 1.0;  ///< of each pixel coordinate
};

/// Where a stereo frame sees a line: the segments in its two images.
struct LineSight {
  Eigen::Vector2d left_start_px = Eigen::Vector2d::Zero();
  Eigen::Vector2d left_end_px = Eigen::Vector2d::Zero();
  Eigen::Vector2d right_start_px = Eigen::Vector2d::Zero();
  Eigen::Vector2d right_end_px = Eigen::Vector2d::Zero();
  double sigma_px = 1.0;  ///< of an end point, across the line
};

/// A point whose place in the previous left camera is known, and where frame k sees it.
struct PointCorrespondence : PointSight {
  Eigen::Vector3d p_prev = Eigen::Vector3d::Zero();      ///< in the previous left camera [m]
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of p_prev [m^2]
  bool far = false;  ///< too far for a disparity: it tells the rotation only
};

/// A line whose place in the previous left camera is known, and where frame k sees it.
struct LineCorrespondence : LineSight {
  Eigen::Vector3d start_prev =
      Eigen::Vector3d::Zero();  ///< end points in the previous left camera [m]
  Eigen::Vector3d end_prev = Eigen::Vector3d::Zero();
  Matrix6d covariance = Matrix6d::Zero();  ///< of (start, end) [m^2]
};

struct Correspondences {
  std::vector<PointCorrespondence> points;
  std::vector<LineCorrespondence> lines;
};

enum class MotionStatus { kOk, kTooFewMatches, kSolverFailed, kTooFewInliers };

/// Lower-case words for a status, for logs, messages and CSV.
const char* toString(MotionStatus status);

/// How the coordinates of weighted residuals are distributed: were the weights true, normally with
/// unit variance, but for the outliers that were removed.
struct ResidualHistogram {
  static constexpr double kBinWidth = 0.25;  ///< [standard deviations]
  static constexpr int kBins = 40;           ///< the outermost hold all beyond them, too
  static constexpr int kMiddle = kBins / 2;  ///< the bin that begins at 0

  std::array<std::int64_t, kBins> counts{};
  double squares = 0.0;  ///< sum over all coordinates

  void add(double value);
  void add(const ResidualHistogram& other);
  std::int64_t size() const;  ///< number of coordinates
  double variance() const;    ///< about 0; 0 of none
};

/// The answer of the estimator; T_curr_prev and covariance mean something only if status is kOk.
struct MotionEstimate {
  MotionStatus status = MotionStatus::kTooFewMatches;
  Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
  /// Covariance of T_prev_curr, i.e. of the camera's motion seen from the previous camera:
  /// translation [m], rotation [rad] about the axes of the previous camera.
  Matrix6d covariance = Matrix6d::Zero();
  std::vector<bool> point_inliers;  ///< one per point correspondence
  std::vector<bool> line_inliers;   ///< one per line correspondence
  int num_point_inliers = 0;
  int num_line_inliers = 0;
  int iterations = 0;
  double rms_px = 0.0;                ///< root mean square of the inliers' residual coordinates
  ResidualHistogram point_residuals;  ///< of the inliers
  ResidualHistogram line_residuals;   ///< of the inliers

  bool ok() const { return status == MotionStatus::kOk; }
};

/// Minimises the point-line reprojection error in frame k (paper, eq. 7) by Levenberg-Marquardt
/// with Huber kernels, removes outliers and solves again with the rest (motion/remove_outliers).
/// \param T_curr_prev_initial where to start: the constant-velocity prediction.
MotionEstimate estimateMotion(const Correspondences& correspondences, const StereoCamera& camera,
                              const Eigen::Isometry3d& T_curr_prev_initial,
                              const MotionParameters& parameters);

/// The same from those matches alone that are seen where the prediction puts them: where most of
/// the view moves on its own, a vehicle in front of the camera, they may be few, but they are the
/// world. \param T_curr_prev_predicted from a velocity that was measured.
MotionEstimate estimateMotionNearPrediction(const Correspondences& correspondences,
                                            const StereoCamera& camera,
                                            const Eigen::Isometry3d& T_curr_prev_predicted,
                                            const MotionParameters& parameters);

/// Combines a motion with a predicted one by their covariances if along some axis the prediction is
/// known better; otherwise it stays as it is. Returns whether it was. \param covariance of the
/// prediction, as MotionEstimate's.
bool supportByPrediction(const Eigen::Isometry3d& T_prev_curr_predicted, const Matrix6d& covariance,
                         MotionEstimate* motion);

/// Fuses the rotation of `direct` (k-1 -> k) with that of the two-frame estimate by slerp at one
/// half (paper, eq. 9-10) and solves for the translation again with the rotation held. \param
/// T_curr_prev2 estimate over two frames, k-2 -> k. \param T_prev_prev2 estimate k-2 -> k-1.
MotionEstimate fuseRotation(const MotionEstimate& direct, const Eigen::Isometry3d& T_curr_prev2,
                            const Eigen::Isometry3d& T_prev_prev2,
                            const Correspondences& correspondences, const StereoCamera& camera,
                            const MotionParameters& parameters);

}  // namespace point_line_odometry
