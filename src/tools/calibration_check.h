#pragma once

#include <Eigen/Core>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "motion/corrected_calibration.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/stereo_odometry.h"

namespace point_line_odometry {

/// Medians of the points in a part of an image.
struct ResidualCell {
  int points = 0;
  Eigen::Vector2d centre_px = Eigen::Vector2d::Zero();
  Eigen::Vector2d residual_px = Eigen::Vector2d::Zero();
};

/// The residuals of an image against its calibration, in parts of it by rows.
struct ResidualField {
  static constexpr int kFewestPoints = 20;  ///< fewer in a part say nothing

  std::vector<ResidualCell> cells;

  /// Parts with enough points.
  int used() const;

  /// The amount of their residuals.
  FieldSize size() const;
};

/// What is known of a calibration.
struct CalibrationReport {
  StereoCamera camera;  ///< rectified
  int frames = 0;
  int points = 0;                             ///< inliers of all frames
  double cell_px = 0.0;                       ///< side of a part of the image
  double vertical_disparity_median_px = 0.0;  ///< of its amount
  ResidualField left;                         ///< reprojection residuals
  ResidualField left_refined;                 ///< the same with online stereo calibration
  ResidualField right;  ///< in columns: reprojection residuals; in rows: vertical disparities
  std::vector<Eigen::Vector2d> estimated_px;  ///< displacement of the right image at the centres of
                                              ///< its parts, by the online stereo calibration
  FieldSize rows;                             ///< vertical disparities of the parts
  FieldSize rows_refined;                     ///< the same without the estimate
  FieldSize columns_estimated;                ///< over the whole image: bias of the disparity
  FieldSize rows_estimated;                   ///< over the whole image
  bool corrects_columns = false;  ///< the estimate lowers what was measured: it is corrected
  bool corrects_rows = false;
  bool agrees = true;              ///< what was measured, less what is corrected, is small
  CorrectedCalibration corrected;  ///< the given one if neither
  cv::Mat last_left;               ///< rectified, CV_8UC1
  cv::Mat last_right;
};

/// Measures how images agree with their calibration. Two odometries run: one without online stereo
/// calibration, whose residuals are against the calibration, and one with it, for its estimate. The
/// estimate for columns or rows is taken only if it lowers the residuals of the parts of the image
/// by a fifth: noise and wrong matches, which it follows as well, have no such part.
class CalibrationCheck {
 public:
  /// Throws std::invalid_argument if the calibration cannot be used. \param raw whether the images
  /// are to be rectified by it. \param parameters but for tracking/refine_calibration.
  CalibrationCheck(const StereoCalibration& calibration, bool raw, const Parameters& parameters);

  void add(const StereoImages& images);

  int frames() const { return frames_; }

  /// Throws InputError if what was seen is too little to tell anything.
  CalibrationReport report() const;

 private:
  /// Residuals that fell into a part of an image.
  struct Samples {
    std::vector<float> columns;
    std::vector<float> rows;
  };

  using SamplesOfParts = std::vector<Samples>;

  std::size_t cellOf(const Eigen::Vector2f& pixel) const;
  void addLeft(const FrameResult& result, SamplesOfParts* samples) const;
  void addRight(const FrameResult& result);
  ResidualField medians(const SamplesOfParts& samples) const;
  RightDisplacement displacement() const;
  void correct(const RightDisplacement& displacement, CalibrationReport* report) const;

  StereoCalibration calibration_;
  StereoCamera camera_;
  std::unique_ptr<StereoRectifier> rectifier_;
  StereoOdometry given_;
  StereoOdometry refined_;
  int columns_;
  int rows_;
  double cell_px_;
  SamplesOfParts left_;
  SamplesOfParts left_refined_;
  SamplesOfParts right_;
  int frames_ = 0;
  cv::Mat last_left_;
  cv::Mat last_right_;
};

/// The report in words.
std::string formatReport(const CalibrationReport& report);

}  // namespace point_line_odometry
