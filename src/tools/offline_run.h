#pragma once

#include <Eigen/Geometry>
#include <map>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <set>
#include <vector>

#include "dataset/imu_data.h"
#include "dataset/wheel_data.h"
#include "odometry/adaptive_feature_budget.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/stereo_odometry.h"
#include "priors/prior_sources.h"
#include "tools/prior_file.h"
#include "tools/recording_replay.h"
#include "tools/run_report.h"
#include "tools/stereo_source.h"

namespace point_line_odometry {

/// Runs the odometry on a source and collects a row for each frame that it accepts.
class OfflineRun {
 public:
  /// \param replay of the recording that the source is of, or null.
  OfflineRun(StereoSource& source, const Parameters& parameters, RecordingReplay* replay);

  /// From now on fewer features are used while frames take longer, as by the nodelet.
  /// \copydetails AdaptiveFeatureBudget::AdaptiveFeatureBudget(double)
  void setTargetFrameTime(double target_ms);

  /// From now on these are the motion priors, of the left camera of the source.
  void setPriors(PriorsByStamp priors);

  /// The use of these until the last frame; nothing without any. \param left_out whether later
  /// frames may have been left out: priors that end after the last one do not count then.
  std::optional<PriorFileUse> priorFileUse(bool left_out) const;

  /// Processes the next frame; false at the end of the source.
  bool step();

  StereoOdometry* odometry() { return &odometry_; }
  const std::vector<FrameRow>& rows() const { return rows_; }
  std::vector<std::int64_t> stamps() const;  ///< of the rows [ns]

  /// Frames without a row: the odometry did not accept them.
  const std::map<TrackingReason, std::size_t>& refused() const { return refused_; }

  const ResidualHistogram& pointResiduals() const { return point_residuals_; }
  const ResidualHistogram& lineResiduals() const { return line_residuals_; }

  /// What is estimated of the gyroscope; nothing without one.
  std::optional<GyroscopeCalibration> gyroscope() const;

  /// What is estimated of gravity; nothing without imu/use_gravity.
  std::optional<GravityCalibration> gravity() const;

  /// The features of the last frame, drawn.
  cv::Mat draw() const;

 private:
  /// Pose of the camera before rectification, R^T T R with the rectifying rotation R, so that the
  /// first pose is still the identity. A replay continues from the recorded pose in odom.
  Eigen::Isometry3d poseOfInputCamera(const Eigen::Isometry3d& T_odom_rectified) const;

  /// Twist and covariances in the axes of the camera before rectification; for a replay, the pose
  /// covariance is in the axes of odom.
  FrameUncertainty uncertaintyOfInputCamera(const FrameResult& result) const;

  void startPriorSources();
  Eigen::Isometry3d T_rectified_input() const;
  std::optional<MotionPrior> priorOf(std::int64_t stamp_ns);
  std::optional<MotionPrior> givenPrior(std::int64_t stamp_ns);
  std::optional<MotionPrior> measuredPrior(std::int64_t stamp_ns);
  void adaptBudget(double frame_ms);

  StereoSource& source_;
  StereoOdometry odometry_;
  RecordingReplay* replay_;
  std::unique_ptr<StereoRectifier> rectifier_;
  Parameters parameters_;  // of the whole budget
  AdaptiveFeatureBudget budget_{0.0};
  std::optional<PriorSources> prior_sources_;  // none for a replay
  ImuData imu_;
  std::size_t next_imu_sample_ = 0;
  WheelData wheels_;
  std::size_t next_wheel_sample_ = 0;
  std::optional<PriorsByStamp> priors_;
  std::set<std::int64_t> matched_priors_;  // by their ends
  std::optional<std::int64_t> last_ns_;    // of the last accepted frame
  cv::Mat left_;
  cv::Mat left_mask_;
  FrameResult result_;
  std::vector<FrameRow> rows_;
  std::map<TrackingReason, std::size_t> refused_;
  ResidualHistogram point_residuals_;
  ResidualHistogram line_residuals_;
};

}  // namespace point_line_odometry
