#pragma once

#include <sensor_msgs/Image.h>
#include <tf2/buffer_core.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "checks/pair_check.h"
#include "dataset/mask_file.h"
#include "point_line_odometry/rectification.h"
#include "ros/calibration_conversion.h"
#include "ros/confirmation.h"
#include "ros/doctor_facts.h"
#include "ros/node_parameters.h"
#include "ros/stereo_input.h"

namespace point_line_odometry {

/// Measurements of the image pair over time: medians of the latest ones, and the drift of the
/// vertical disparity since the first ones. Bounded.
class PairTrend {
 public:
  static constexpr std::size_t kWindow = 5;

  void add(const PairMeasurement& measurement);

  /// Medians, with the counts of the latest measurement; the latest one itself if it found no
  /// matches, nothing before the first one.
  std::optional<PairMeasurement> current() const;

  /// Change of row_offset_px since the first kWindow valid measurements; nothing before
  /// there are kWindow.
  std::optional<double> verticalDrift_px() const;

 private:
  std::deque<PairMeasurement> window_;  // valid ones
  std::optional<PairMeasurement> latest_;
  std::optional<double> first_row_offset_px_;
};

/// Collects the facts of a report. Measures image pairs only in measure(), as that takes about as
/// long as a frame of the odometry. Needs no node; not thread-safe.
class DoctorChecks {
 public:
  /// \param remembers faults of single sets, as of a bag; else they are those of the latest one.
  explicit DoctorChecks(const NodeParameters& parameters, bool remembers = false);

  /// Measures the images of a set, rectified first if the node does so, without what is masked. A
  /// set that cannot be used is skipped: facts() has the reason. A new calibration starts a new
  /// trend, once it is confirmed as by the odometry.
  void measure(const StereoMessages& set);

  /// Follows points from set to set, as SequenceCheck does: for a limited number of consecutive
  /// ones.
  void follow(const StereoMessages& set);

  /// \param tf looked up for the camera's mounting. Left for the caller: image_topics, from_bag,
  /// clock_missing, frame_ms, masks, correction_px, imu, imu_source, wheels_source, odometry_runs,
  /// addOtherParents().
  DoctorFacts facts(const InputFacts& input, const tf2::BufferCore& tf);

 private:
  bool takeCalibration(const StereoMessages& messages);
  template <typename Use>
  void useImages(const StereoMessages& set, const Use& use);
  StereoImages imagesOf(const StereoMessages& set);
  void addMasks(const StereoMessages& set, StereoImages* images) const;
  void noteSeam(std::optional<int> column);
  std::optional<Eigen::Isometry3d> findMounting(const std::string& camera_frame,
                                                const tf2::BufferCore& tf) const;

  const NodeParameters parameters_;
  const bool remembers_;

  std::optional<InfoPair> infos_;  // that the members below are computed from
  Confirmation<InfoPair> other_infos_;
  std::string calibration_change_;
  std::string damage_;
  StereoCalibration calibration_;
  std::optional<StereoCamera> camera_;
  std::optional<StereoRectifier> rectifier_;
  std::string calibration_fault_;
  StaticMasks masks_;
  std::string mask_fault_;  // of a file that cannot be read
  PairTrend trend_;
  std::optional<std::optional<int>> seam_;  // of the pairs measured so far
  std::optional<SequenceCheck> sequence_;
};

/// \param others who publish what the odometry does on tf; see TfParents.
void addOtherParents(const std::vector<TfParents::Source>& others, const tf2::BufferCore& tf,
                     DoctorFacts* facts);

}  // namespace point_line_odometry
