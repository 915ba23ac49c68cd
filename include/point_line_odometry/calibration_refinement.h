#pragma once

#include <Eigen/Core>
#include <optional>
#include <tuple>
#include <vector>

#include "point_line_odometry/motion.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Small smooth displacement of the right image against its calibration: quadratic polynomials of
/// the pixel for each coordinate. They span, to first order, what a wrong rotation, principal
/// point, focal length or tangential distortion of the right camera does.
class RightImageCorrection {
 public:
  static constexpr int kTerms = 6;
  using Coefficients = Eigen::Matrix<double, kTerms, 1>;  // [px]

  RightImageCorrection() = default;
  explicit RightImageCorrection(const StereoCamera& camera)
      : centre_(camera.cx, camera.cy), scale_(2.0 / camera.width) {}

  /// Values of the polynomial's terms 1, x, y, x^2 - 1/3, x y, y^2 at a pixel; x is about +-1 at
  /// the image's sides, y in the same unit. The mean of x^2 is taken out: a constant shift is what
  /// a calibration sees best and has removed.
  Coefficients terms(const Eigen::Vector2d& right_px) const;

  /// The pixel at which a correctly calibrated right camera would have seen the same thing.
  Eigen::Vector2d apply(const Eigen::Vector2d& right_px) const;

  /// How far pixels are displaced: u is a bias of the disparity, v of the rows.
  Coefficients u = Coefficients::Zero();
  Coefficients v = Coefficients::Zero();

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [u_of_this, v_of_this, centre, scale] = *this;
    return std::tie(u_of_this, v_of_this, centre, scale);
  }

 private:
  Eigen::Vector2d centre_ = Eigen::Vector2d::Zero();
  double scale_ = 0.0;
};

/// What one motion says of the coefficients of the disparity, in information form.
struct CalibrationEvidence {
  Eigen::Matrix<double, RightImageCorrection::kTerms, RightImageCorrection::kTerms> information =
      decltype(information)::Zero();
  RightImageCorrection::Coefficients vector = RightImageCorrection::Coefficients::Zero();

  auto state() { return std::tie(information, vector); }
};

/// Estimates the correction of the right image while the odometry runs. Rows that differ between
/// left and right show v directly. A biased disparity, u, shows when the camera moves: the depths
/// that it gives do not fit the flow of the pixels. Each frame adds its information on the
/// coefficients, the motion marginalised out; old information fades.
class CalibrationRefinement {
 public:
  explicit CalibrationRefinement(const StereoCamera& camera);

  const RightImageCorrection& correction() const { return correction_; }

  /// One frame's rows: where its stereo matches are seen in the right image, uncorrected, and by
  /// how much lower than in the left.
  struct RowSample {
    Eigen::Vector2d right_px;
    double row_difference_px;
  };
  void addRows(const std::vector<RowSample>& samples, double sigma_px);

  /// One frame's motion: residuals of the inlier points, after the solution. \param share_of_new of
  /// the features seen, 0 ... 1. It weighs the frame by its square: points seen again repeat their
  /// errors, and those that all points have in common bias the disparity the more the less the
  /// camera has moved. Nothing where it is not known, as for the first motion of a map: then that
  /// of the next motion is taken.
  void addMotion(const Correspondences& correspondences, const MotionEstimate& motion,
                 const MotionParameters& parameters, const std::optional<double>& share_of_new);

  /// What it has learned, for StereoOdometry::saveState(); the camera is given.
  auto state();

 private:
  using Coefficients = RightImageCorrection::Coefficients;
  using Information =
      Eigen::Matrix<double, RightImageCorrection::kTerms, RightImageCorrection::kTerms>;

  /// Gaussian belief about coefficients in information form.
  struct Belief {
    Information prior;
    Information information;
    Coefficients vector = Coefficients::Zero();

    /// \param prior_sigma of each coefficient [px], about zero.
    explicit Belief(const Coefficients& prior_sigma);
    void add(const Information& information, const Coefficients& vector);
    Coefficients mean() const;
    auto state() { return std::tie(prior, information, vector); }
  };

  void add(const CalibrationEvidence& evidence, double share_of_new);

  StereoCamera camera_;
  RightImageCorrection correction_;
  Belief u_;
  Belief v_;
  /// Of a motion whose share of new features is not known yet.
  std::optional<CalibrationEvidence> waiting_;
};

inline auto CalibrationRefinement::state() {
  auto& [camera, correction, u, v, waiting] = *this;
  static_cast<void>(camera);
  return std::tie(correction, u, v, waiting);
}

}  // namespace point_line_odometry
