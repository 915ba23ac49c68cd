#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "checks/pair_check.h"
#include "checks/sequence_check.h"
#include "point_line_odometry/stereo_camera.h"
#include "ros/doctor_imu.h"
#include "ros/frame_messages.h"
#include "ros/node_parameters.h"
#include "ros/rim_agreement.h"
#include "ros/source_facts.h"
#include "ros/stereo_input.h"
#include "ros/tf_parents.h"

namespace point_line_odometry {

/// The latest image of one camera.
struct ImageFacts {
  std::string encoding;
  int width = 0;      ///< [px]
  int height = 0;     ///< [px]
  std::string fault;  ///< why it cannot be used, with a hint; empty if it can
};

/// What is known of the masks in use.
struct MaskFacts {
  double left_share = 0.0;  ///< of the pixels, masked in the latest frame
  double right_share = 0.0;
  std::uint64_t frames = 0;
  std::uint64_t missing = 0;  ///< masks of the topics, see FrameMasks
  std::string fault;          ///< of the latest mask that could not be used
  RimAgreement rim;

  void add(const ProcessedFrame& frame);
};

/// Everything that the report is made from.
struct DoctorFacts {
  NodeParameters parameters;
  InputFacts input;
  std::vector<std::string> image_topics;  ///< available ones, if a topic is missing

  std::array<std::optional<ImageFacts>, 2> images;  ///< left, right; nothing: none received
  std::optional<StereoCamera> camera;               ///< nothing: not known, or camera_info is bad
  std::string calibration_fault;                    ///< with a hint; empty if there is none
  std::string calibration_change;  ///< what was not as before in some of the sets; empty if nothing
  std::string damage;              ///< why some pair cannot be used, with a hint; empty if all can

  std::optional<PairMeasurement> pair;  ///< nothing: not measured yet
  /// StereoCorrection::rmsPx() of a node's odometry; nothing: no frame processed yet.
  std::optional<Eigen::Vector2d> correction_px;
  std::optional<int> seam_column;               ///< see commonSeam(): in all pairs measured
  std::optional<double> vertical_drift_px;      ///< of row_offset_px since the start
  std::optional<SequenceMeasurement> sequence;  ///< nothing: no consecutive pairs were followed

  std::string camera_frame;  ///< of the left image's header
  std::optional<Eigen::Isometry3d> T_base_camera;
  std::string topmost_frame;  ///< that tf has the camera's frame below; itself if tf has none
  std::vector<TfParents::Source> other_parents;  ///< who else publishes what the odometry does
  std::string topmost_of_other;  ///< topmostFrame() of the parent in the first of these

  std::optional<MaskFacts> masks;  ///< nothing: no frame processed yet
  std::string mask_fault;          ///< of the files, with a hint; empty if there is none

  std::optional<ImuCheckFacts> imu;  ///< nothing: there is none to be checked

  std::optional<SourceFacts> imu_source;  ///< of a node; nothing: none, or not known yet
  std::optional<SourceFacts> wheels_source;

  std::optional<double> frame_ms;  ///< mean time for a frame on this computer

  bool from_bag = false;
  /// True if use_sim_time is set and no /clock has been received.
  bool clock_missing = false;
  bool odometry_runs = true;  ///< false: it is not known to publish on tf
};

}  // namespace point_line_odometry
