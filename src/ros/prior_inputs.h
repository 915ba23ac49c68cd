#pragma once

#include <ros/node_handle.h>
#include <ros/time.h>
#include <tf2_ros/buffer.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "point_line_odometry/parameters.h"
#include "priors/prior_sources.h"
#include "ros/log_throttle.h"
#include "ros/node_parameters.h"
#include "ros/sample_input.h"
#include "ros/sensor_mounting.h"
#include "ros/source_facts.h"
#include "ros/tf_guess.h"

namespace point_line_odometry {

/// Where the samples of motion priors come from: the topics `imu` and `prior_odom`, or for the
/// latter tf, with guess_frame_id. Callbacks only queue. For one thread, once images come.
class PriorInputs {
 public:
  /// \param name of the node, for its log. \param look_up of a sensor's pose in the base.
  PriorInputs(const ros::NodeHandle& nh, std::string name, NodeParameters parameters,
              const tf2_ros::Buffer& tf, const SensorMounting::Lookup& look_up);

  /// Subscribes to what the parameters enable, and to nothing else.
  void enable(const Parameters& core);

  /// Hands over the samples until a frame, for which it waits a bounded time: what the frame uses
  /// depends on stamps. \param stamp of the frame.
  void takeUntil(const ros::Time& stamp, PriorSources* sources);

  /// What is known of the sources at the last frame; nothing of one that is not in use.
  std::optional<SourceFacts> imuFacts(const PriorSources& sources) const;
  std::optional<SourceFacts> wheelFacts(const PriorSources& sources) const;

  /// Pose of the base in guess_frame_id at the last frame; nothing if tf does not have it.
  const std::optional<Eigen::Isometry3d>& T_guess_base() const { return T_guess_base_; }

 private:
  /// A sensor's place on the robot, and its samples so far.
  struct Sensor {
    explicit Sensor(SensorMounting of_sensor) : mounting(std::move(of_sensor)) {}

    SensorMounting mounting;
    std::uint64_t unmounted = 0;            // samples of which the place is not known
    std::string fault;                      // of the last sample, empty if there is none
    std::optional<std::int64_t> newest_ns;  // stamp of the last sample
    int silent_frames = 0;                  // in a row
  };

  void takeImu(PriorSources* sources);
  void takeWheels(PriorSources* sources);
  void takeGuess(const ros::Time& stamp, PriorSources* sources);
  const Eigen::Isometry3d* poseOf(const std::string& frame, Sensor* sensor);
  void describe(const Sensor& sensor, SourceFacts* facts) const;
  std::string imuTimeout() const;
  std::string wheelTimeout() const;
  void warnIfSilent(bool alive, const std::string& timeout, Sensor* sensor) const;

  const ros::NodeHandle nh_;
  const std::string name_;
  const NodeParameters parameters_;
  LogThrottle log_throttle_;
  Sensor imu_sensor_;
  Sensor wheel_sensor_;
  std::optional<TfGuess> guess_;                   // with guess_frame_id
  std::optional<Eigen::Isometry3d> T_guess_base_;  // at the last frame
  std::uint64_t num_guesses_ = 0;
  std::uint64_t missing_guesses_ = 0;
  std::int64_t frame_ns_ = 0;  // stamp of the last frame
  ImuInput imu_{"imu"};        // after what their callbacks use
  WheelInput wheels_{"prior_odom"};
};

}  // namespace point_line_odometry
