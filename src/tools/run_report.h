#pragma once

/// \file
/// The report of offline_odometry on a run: rows of frames, and the content of its files.

#include <Eigen/Core>
#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "dataset/trajectory.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/gravity.h"
#include "point_line_odometry/gyroscope.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/residual_histogram.h"
#include "point_line_odometry/types.h"
#include "tools/prior_file.h"
#include "tools/recording_replay.h"

namespace point_line_odometry {

/// Pose covariance and twist with covariance of a frame; of the camera of the FrameRow.
struct FrameUncertainty {
  Matrix6d pose_covariance = Matrix6d::Zero();  ///< along and about the axes of the first camera
  Vector6d twist = Vector6d::Zero();            ///< in the camera's axes
  Matrix6d twist_covariance = Matrix6d::Zero();
  double twist_over_s = 0.0;  ///< as in FrameResult
};

/// The values of a frame for the files of a run.
struct FrameRow {
  StampedPose pose;  ///< of the left camera (of the raw one if images were rectified)
  TrackingState state = TrackingState::kInitializing;
  TrackingReason reason = TrackingReason::kNone;
  FrameCounts counts;
  double rms_px = 0.0;
  StageTimes times;
  double decode_ms = 0.0;
  double rectify_ms = 0.0;
  double feature_budget = 1.0;  ///< share of the configured numbers of features in use
  FrameUncertainty uncertainty;
  PriorReport prior;
};

/// The values of a run that are not of a frame.
struct RunInfo {
  std::string input;
  std::string line_detector;     ///< that was used
  std::string point_descriptor;  ///< likewise
  Eigen::Vector2d correction_px =
      Eigen::Vector2d::Zero();  ///< StereoCorrection::rmsPx() at the end
  std::size_t unsynchronized_images = 0;
  std::map<TrackingReason, std::size_t> refused;  ///< frames that the odometry did not accept
  std::vector<std::string> warnings;  ///< what was left out of the input, and what else is odd
  std::vector<std::string> files;     ///< in the folder of the results, but for report.html
  double wall_s = 0.0;
  ResidualHistogram point_residuals;  ///< of all frames
  ResidualHistogram line_residuals;
  std::optional<GyroscopeCalibration> gyroscope;  ///< at the end
  std::optional<GravityCalibration> gravity;      ///< at the end
  std::optional<PriorFileUse> prior_file;         ///< with --priors
  std::optional<RecordingComparison> recording;   ///< of the replay of a recording
  Parameters parameters;                          ///< at the end
};

/// frames.csv: a row for every frame.
std::string formatFramesCsv(const std::vector<FrameRow>& rows);

/// uncertainty.csv: a row for every frame with its twist and the upper triangles, row by row, of
/// the covariances of twist and pose; (x, y, z, about x, about y, about z) in m, rad and s.
std::string formatUncertaintyCsv(const std::vector<FrameRow>& rows);

/// summary.json: the run for scripts. Numbers have 4 decimals at most.
std::string formatSummaryJson(const std::vector<FrameRow>& rows, const RunInfo& info);

/// Files and folders that an earlier run has written to a folder, by its summary.json.
std::set<std::string> filesOfEarlierRun(const std::string& folder);

/// The table that is printed at the end of a run.
std::string formatTable(const std::vector<FrameRow>& rows, const RunInfo& info);

}  // namespace point_line_odometry
