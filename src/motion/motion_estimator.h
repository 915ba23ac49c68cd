#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "common/thread_pool.h"
#include "motion/correspondence.h"
#include "motion/prior_factor.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/residual_histogram.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

enum class MotionStatus { kOk, kTooFewMatches, kSolverFailed, kTooFewInliers };

/// Lower-case words for a status, for logs, messages and CSV.
const char* toString(MotionStatus status);

/// Result of the estimator; T_curr_prev and covariance are valid only if status is kOk.
struct MotionEstimate {
  MotionStatus status = MotionStatus::kTooFewMatches;
  Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
  /// Covariance of T_prev_curr: translation [m] along and rotation [rad] about the axes of the
  /// previous camera.
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
  int numInliers() const { return num_point_inliers + num_line_inliers; }
};

/// Minimises the point-line reprojection error in frame k (paper, eq. 7) by Levenberg-Marquardt
/// with a Huber loss, removes outliers and solves again with the rest (motion/remove_outliers).
/// \param T_curr_prev_initial initial value: the constant-velocity prediction. \param threads
/// evaluate the residuals, here and below; null: the thread that calls.
MotionEstimate estimateMotion(const Correspondences& correspondences, const StereoCamera& camera,
                              const Eigen::Isometry3d& T_curr_prev_initial,
                              const MotionParameters& parameters, ThreadPool* threads = nullptr);

/// The same from the matches with small reprojection errors at the prediction and those that agree
/// with their motion: where an independently moving object, e.g. a vehicle in front of the camera,
/// fills most of the view, they may be few, but they are of the static scene. If they are too few,
/// from those with errors up to 8 px, of which half must agree. \param T_curr_prev_predicted from
/// an estimated velocity.
MotionEstimate estimateMotionNearPrediction(const Correspondences& correspondences,
                                            const StereoCamera& camera,
                                            const Eigen::Isometry3d& T_curr_prev_predicted,
                                            const MotionParameters& parameters,
                                            ThreadPool* threads = nullptr);

/// A motion prior as a residual, and the motion that is predicted with it.
struct PriorMotion {
  PriorFactor factor;
  Eigen::Isometry3d T_curr_prev_predicted;
};

/// Estimates again with a motion prior as one more residual. \param images the estimate without it:
/// from its inliers, or from all matches and the predicted motion if it is not ok. Nothing if there
/// is no solution.
std::optional<MotionEstimate> estimateWithPrior(
    const MotionEstimate& images, const PriorMotion& prior, const Correspondences& correspondences,
    const StereoCamera& camera, const MotionParameters& parameters, ThreadPool* threads = nullptr);

/// Fuses a motion with a predicted one by their covariances (Kalman update) if the prediction has
/// the smaller variance along some axis; otherwise the motion is unchanged. Returns whether they
/// were fused. \param covariance of the prediction, as MotionEstimate's.
bool constrainByPrediction(const Eigen::Isometry3d& T_prev_curr_predicted,
                           const Matrix6d& covariance, MotionEstimate* motion);

/// The motion over two frames, and its first half.
struct TwoFrameMotion {
  Eigen::Isometry3d T_curr_prev2;  ///< k-2 -> k
  Eigen::Isometry3d T_prev_prev2;  ///< k-2 -> k-1
};

/// Fuses the rotation of `frame_to_frame` (k-1 -> k) with that of the two-frame estimate by slerp
/// at one half (paper, eq. 9-10) and estimates the translation again with the rotation fixed. Its
/// covariance covers the frame-to-frame motion, too.
MotionEstimate fuseRotation(const MotionEstimate& frame_to_frame, const TwoFrameMotion& two_frames,
                            const Correspondences& correspondences, const StereoCamera& camera,
                            const MotionParameters& parameters, ThreadPool* threads = nullptr);

}  // namespace point_line_odometry
