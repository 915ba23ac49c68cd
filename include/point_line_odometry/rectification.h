#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Calibration of one raw camera in the fields of sensor_msgs/CameraInfo.
struct CameraCalibration {
  int width = 0;                                ///< [px]
  int height = 0;                               ///< [px]
  std::string distortion_model = "plumb_bob";   ///< plumb_bob, rational_polynomial or equidistant
  std::vector<double> D;                        ///< distortion coefficients, empty for none
  Eigen::Matrix3d K = Eigen::Matrix3d::Zero();  ///< intrinsics of the raw image [px]
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();  ///< R_rectified_raw: rotates raw camera
                                                    ///< coordinates to rectified
  Eigen::Matrix<double, 3, 4> P =
      Eigen::Matrix<double, 3, 4>::Zero();  ///< projection of the rectified camera [px]
};

/// Calibration of a stereo pair. P of the right camera contains the baseline: P(0, 3) = -fx *
/// baseline.
struct StereoCalibration {
  CameraCalibration left;   ///< the frame of the stereo pair
  CameraCalibration right;  ///< to the right of it
};

/// The rectified pair that the two P matrices describe. Throws std::invalid_argument that names the
/// field, its value and what to do if the P matrices are zero, not finite, of different cameras, or
/// give a baseline <= 0.
StereoCamera rectifiedCamera(const StereoCalibration& calibration);

/// Pose of the right camera in the left one, of the cameras that take the images (the rectified
/// ones if R is the identity), from R and P of both.
Eigen::Isometry3d poseOfRightInLeft(const StereoCalibration& calibration);

/// Fills R and P of both cameras from K, D and the pose of the right camera, such that rows of the
/// rectified images correspond and no pixel outside the raw images is seen (Bouguet's method,
/// cv::stereoRectify with alpha = 0). \param T_right_left maps coordinates of the raw left camera
/// to the raw right camera.
StereoCalibration rectifyCalibration(StereoCalibration calibration,
                                     const Eigen::Isometry3d& T_right_left);

/// Turns raw image pairs into rectified ones. The look-up tables are computed once.
class StereoRectifier {
 public:
  /// Throws std::invalid_argument like rectifiedCamera(), and if K or R is unusable or the
  /// distortion model unknown.
  explicit StereoRectifier(const StereoCalibration& calibration);

  /// Rectified copies of a raw CV_8UC1 pair of the calibrated size and of its masks (throws
  /// std::invalid_argument for other sizes). What the raw image does not show is masked, as with a
  /// P that keeps all of its pixels (alpha 1 of stereoRectify).
  StereoImages rectify(const StereoImages& raw) const;

  /// The camera that would take the rectified images.
  const StereoCamera& camera() const { return camera_; }

  /// Rotates coordinates of the raw left camera to the rectified left camera.
  const Eigen::Matrix3d& R_rectified_raw() const { return R_rectified_raw_; }

 private:
  struct Maps {
    cv::Mat xy;      // CV_16SC2: integer source pixel
    cv::Mat weight;  // CV_16UC1: index of the interpolation weights
    cv::Mat seen;    // CV_8UC1: 0 where a pixel is not in the raw image; empty: all are
  };

  static cv::Mat rectifyMask(const cv::Mat& raw, const Maps& maps);

  StereoCamera camera_;
  Eigen::Matrix3d R_rectified_raw_;
  std::array<Maps, 2> maps_;
};

}  // namespace point_line_odometry
