#pragma once

#include <Eigen/Core>
#include <optional>
#include <tuple>
#include <vector>

#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/motion_estimator.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/stereo_correction.h"

namespace point_line_odometry {

/// Information of one motion on the coefficients of the disparity.
struct CalibrationEvidence {
  StereoCorrection::Information information = StereoCorrection::Information::Zero();
  StereoCorrection::Coefficients vector = StereoCorrection::Coefficients::Zero();

  auto state() { return std::tie(information, vector); }
};

/// What the residuals of a motion's inlier points say at the estimate, with the motion marginalised
/// out. \param correction with which they were observed. Nothing if they are not finite.
std::optional<CalibrationEvidence> calibrationEvidence(const Correspondences& correspondences,
                                                       const MotionEstimate& motion,
                                                       const MotionParameters& parameters,
                                                       const StereoCamera& camera,
                                                       const StereoCorrection& correction);

/// Estimates the correction of the right image while the odometry runs. Vertical disparities
/// measure v directly. A bias of the disparity, u, is observable when the camera moves: the
/// triangulated depths then disagree with the optical flow. Each frame adds its information on the
/// coefficients; old information decays exponentially. A calibrated camera has a small u, but at
/// the image's sides, and in y^2 where v shows tangential distortion. One that was knocked has that
/// of a rotation: roll and pitch displace rows, too, as does another focal length; where v shows
/// more of that than lenses explain, u is expected to be the rest of it, before the camera has
/// moved. A yaw is taken from the motions. As far as noise explains what else they show of u, as a
/// whole, it is left out: of an exact camera it would be an error, of all distances in the same
/// direction.
class OnlineStereoCalibration {
 public:
  explicit OnlineStereoCalibration(const StereoCamera& camera);

  const StereoCorrection& correction() const { return correction_; }

  /// A stereo match: its uncorrected pixel in the right image, and its row there minus that in the
  /// left image.
  struct VerticalDisparity {
    Eigen::Vector2d right_px;
    double vertical_disparity_px;
  };
  void addVerticalDisparities(const std::vector<VerticalDisparity>& samples, double sigma_px);

  /// Whether any frame has shown v.
  bool knowsVertical() const;

  /// Adds one frame's motion. \param share_of_new share of new features in the frame, 0 ... 1. Its
  /// cube weights the frame: tracked points repeat their errors, and errors common to all points
  /// bias the disparity more the less the camera moves. Nothing if unknown, as for the first motion
  /// of a map: then one is assumed until that of the next motion is known.
  void addMotion(const CalibrationEvidence& evidence, const std::optional<double>& share_of_new);

  /// The estimate, for StereoOdometry::saveState(); the camera is not part of it.
  auto state();

 private:
  using Coefficients = StereoCorrection::Coefficients;
  using Information = StereoCorrection::Information;
  using Covariance = Eigen::Matrix<double, StereoCorrection::kTerms, StereoCorrection::kTerms>;

  /// What was observed of coefficients: a Gaussian in information form.
  struct Likelihood {
    Information information = Information::Zero();
    Coefficients vector = Coefficients::Zero();

    void add(const Information& information, const Coefficients& vector);
    /// With a prior of this information about the expected coefficients.
    Coefficients mean(const Information& prior, const Coefficients& expected) const;
    Coefficients variance(const Information& prior) const;
    auto state() { return std::tie(information, vector); }
  };

  /// What is expected of u by the rows and by the yaw that the motions show.
  struct DisparityPrior {
    Coefficients mean = Coefficients::Zero();
    Coefficients variance_by_rows = Coefficients::Zero();  ///< what the rows leave open [px^2]
    double yaw_sigma_px = 0.0;  ///< standard deviation of the constant term of a yaw

    /// With the variance of a calibrated camera.
    Information information() const;
  };

  /// What the motions show of u.
  struct LikelihoodByMotions : Likelihood {
    /// Covariance of `vector`, by the scatter of each motion about the mean of those before it.
    Information scatter = Information::Zero();

    /// The mean, moved towards that without the variance of a calibrated camera as far as noise
    /// explains the difference, all coefficients by the same share.
    Coefficients shrunkMean(const DisparityPrior& prior) const;
    auto state() { return std::tie(information, vector, scatter); }
  };

  /// What a yaw of the right camera does.
  struct Yaw {
    Coefficients u = Coefficients::Zero();  ///< the displacement
    double sigma_px = 0.0;                  ///< standard deviation of its constant term
  };

  void add(const CalibrationEvidence& motion, double share_of_new, LikelihoodByMotions* u) const;
  void update();
  DisparityPrior disparityPrior(const Likelihood& u) const;
  double lensErrorPx() const;
  DisparityPrior expectedByRows(const Coefficients& v_variance) const;
  Yaw yaw(const Likelihood& u, const DisparityPrior& by_rows) const;
  double tangentialPx(const Yaw& yaw, const Coefficients& v_variance) const;

  StereoCamera camera_;
  StereoCorrection correction_;
  LikelihoodByMotions u_;
  Likelihood v_;
  /// Of a motion whose share of new features is still unknown.
  std::optional<CalibrationEvidence> waiting_;
};

/// The vertical disparities of the stereo points of a frame.
std::vector<OnlineStereoCalibration::VerticalDisparity> verticalDisparities(
    const StereoFrame& frame);

inline auto OnlineStereoCalibration::state() {
  auto& [camera, correction, u, v, waiting] = *this;
  static_cast<void>(camera);
  return std::tie(correction, u, v, waiting);
}

}  // namespace point_line_odometry
