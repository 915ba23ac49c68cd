#pragma once

#include <Eigen/Core>
#include <tuple>

#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Smooth displacement of the right image against its calibration: a polynomial of the pixel for
/// each coordinate. Its quadratic terms span, to first order, the displacement by an error of the
/// right camera's rotation, principal point, focal length or tangential distortion; x^4 is what a
/// calibration leaves at the image's sides (KITTI: 2 px).
class StereoCorrection {
 public:
  static constexpr int kTerms = 7;  ///< number of monomials of a polynomial
  /// disparity_error_px of a camera that is calibrated, and corrected online.
  static constexpr double kCalibratedPx = 0.05;
  /// Coefficients of the monomials [px].
  using Coefficients = Eigen::Matrix<double, kTerms, 1>;
  /// Information on coefficients [px^-2].
  using Information = Eigen::Matrix<double, kTerms, kTerms>;

  StereoCorrection() = default;
  /// No displacement, for the images of a camera.
  explicit StereoCorrection(const StereoCamera& camera)
      : centre_(camera.cx, camera.cy), scale_(2.0 / camera.width) {}

  /// Values of the polynomial's terms 1, x, y, x^2 - 1/3, x y, y^2, x^4 at a pixel; x is about +-1
  /// at the image's sides, y in the same unit. The mean of x^2 over the image is subtracted: a
  /// constant shift is what a calibration observes best and has removed. That of x^4 is not: with
  /// it a calibration leaves nothing in the middle of the image.
  Coefficients terms(const Eigen::Vector2d& right_px) const;

  /// The pixel at which a correctly calibrated right camera would observe the same point.
  Eigen::Vector2d apply(const Eigen::Vector2d& right_px) const;
  LineSegment apply(const LineSegment& right) const;  ///< the same of both ends

  /// The pixel that apply() takes here, to first order of the displacement.
  Eigen::Vector2d remove(const Eigen::Vector2d& calibrated_px) const {
    return 2.0 * calibrated_px - apply(calibrated_px);
  }

  /// Mean of the displacement over the right image of this camera: along the rows, thus of the
  /// disparity, and along the columns [px]. The correction may be that of scaled images.
  Eigen::Vector2d meanPx(const StereoCamera& camera) const;
  Eigen::Vector2d rmsPx(const StereoCamera& camera) const;  ///< root mean square of the same

  Coefficients u = Coefficients::Zero();  ///< horizontal displacement: a bias of the disparity
  Coefficients v =
      Coefficients::Zero();  ///< vertical displacement: a bias of the vertical disparity
  /// Standard deviation of an error that all corrected disparities have in common [px].
  double disparity_error_px = kCalibratedPx;

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [u_of_this, v_of_this, disparity_error, centre, scale] = *this;
    return std::tie(u_of_this, v_of_this, disparity_error, centre, scale);
  }

 private:
  /// Displacements of a grid of pixels of this camera's image, a column each [px].
  Eigen::Matrix2Xd displacements(const StereoCamera& camera) const;

  Eigen::Vector2d centre_ = Eigen::Vector2d::Zero();
  double scale_ = 0.0;
};

}  // namespace point_line_odometry
