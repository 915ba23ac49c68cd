#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// What is known about the camera's motion between two frames before their images are compared: by
/// a gyroscope, wheels or any other source that does not use these images.
struct MotionPrior {
  std::int64_t from_ns = 0;  ///< stamp of the last frame that the odometry accepted
  std::int64_t to_ns = 0;    ///< stamp of the frame that it comes with
  /// Pose of the rectified left camera at `to_ns` in that at `from_ns`.
  Eigen::Isometry3d T_prev_curr = Eigen::Isometry3d::Identity();
  /// Inverse covariance of T_prev_curr, along and about the axes of the camera at `from_ns` [1/m^2,
  /// 1/rad^2]; zero along and about axes of which nothing is known. An error is independent of
  /// those of other sources; successive priors of one may have the same.
  Matrix6d information = Matrix6d::Zero();
};

/// The prior of a camera from that of a body on which it is mounted, whose information is along and
/// about the axes of the body at `from_ns`. \param T_body_camera pose of the camera in the body.
MotionPrior ofCamera(const MotionPrior& of_body, const Eigen::Isometry3d& T_body_camera);

/// One prior of several with independent errors and the same stamps: the most probable motion, with
/// the sum of their information. Nothing of none.
std::optional<MotionPrior> fused(const std::vector<MotionPrior>& priors);

/// What became of a frame's prior.
enum class PriorUse {
  kNone,       ///< there was none, or the pose is kept
  kUsed,       ///< in the prediction and, as a relative-pose factor, in the estimate
  kCarried,    ///< the frame has no motion by its images: the pose follows the prior
  kRejected,   ///< it disagrees with the images: the frame was estimated without it
  kSuspended,  ///< too many were rejected: it is only compared with the images, until they agree
  kInvalid     ///< not finite, not symmetric, not positive, or of other stamps
};

/// Lower-case name, as in frames.csv and OdometryInfo.
const char* toString(PriorUse use);

/// The use of a frame's prior, and how well it agrees with the images.
struct PriorReport {
  PriorUse use = PriorUse::kNone;  ///< what became of it
  /// Squared Mahalanobis distance of the prior from the motion by the images alone; 0 if they gave
  /// none.
  double chi_square = 0.0;
  int axes = 0;  ///< that the prior knows: degrees of freedom of chi_square
};

}  // namespace point_line_odometry
