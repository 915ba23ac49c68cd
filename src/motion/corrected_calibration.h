#pragma once

#include <Eigen/Core>
#include <functional>

#include "point_line_odometry/rectification.h"

namespace point_line_odometry {

/// Displacement of the rectified right image: the pixel of a correctly calibrated right camera for
/// a pixel of the given one, as StereoCorrection::apply().
using RightDisplacement = std::function<Eigen::Vector2d(const Eigen::Vector2d& right_px)>;

/// Root mean square and largest amount over the image [px].
struct FieldSize {
  double rms_px = 0.0;
  double max_px = 0.0;
};

/// A calibration with another right camera, and how it differs.
struct CorrectedCalibration {
  StereoCalibration calibration;
  FieldSize change;     ///< of the rectified right image
  FieldSize remaining;  ///< of the displacement, which no parameter of the camera expresses
};

/// Fits rotation, focal lengths, principal point and, unless the distortion is equidistant, the
/// tangential distortion of the right camera, such that its rectified images have the displacement
/// no more: least squares over a grid of the image, whose middle counts more than its sides, with
/// the smallest change where several explain it alike; none if no less would remain. Radial
/// distortion is kept: it has none of the quadratic terms of the displacement. The left camera and
/// both P, hence the rectified pair, stay as they are; images that are rectified already may have K
/// = P, no D and the identity as R. Throws std::invalid_argument as StereoRectifier.
CorrectedCalibration correctedCalibration(const StereoCalibration& calibration,
                                          const RightDisplacement& displacement);

}  // namespace point_line_odometry
