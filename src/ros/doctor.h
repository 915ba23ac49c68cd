#pragma once

#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <ros/time.h>
#include <tf2_ros/buffer.h>

#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "ros/diagnostics.h"
#include "ros/doctor_checks.h"
#include "ros/doctor_report.h"
#include "ros/log_throttle.h"
#include "ros/node_parameters.h"
#include "ros/stereo_subscriber.h"
#include "ros/tf_parents.h"

namespace point_line_odometry {

/// Image topics that the master knows, raw and compressed, without those of the odometry; empty if
/// it does not answer.
std::vector<std::string> publishedImageTopics();

/// True if use_sim_time is set and no /clock has been received.
bool isClockMissing();

/// Checks the input of a running node in a thread of its own: reports to the log and the latched
/// topic `doctor` when ReportSchedule says so, and to the diagnostics once a second.
class Doctor {
 public:
  /// What is checked; all must outlive the doctor.
  struct Sources {
    const StereoSubscriber* subscriber;
    const tf2_ros::Buffer* tf;
    Diagnostics* diagnostics;
  };

  /// \param nh `doctor` is resolved here. \param name of the node, for the report.
  Doctor(ros::NodeHandle nh, const NodeParameters& parameters, const std::string& name,
         const Sources& sources);

  /// Returns when the check in progress has ended.
  ~Doctor();

  Doctor(const Doctor&) = delete;
  Doctor& operator=(const Doctor&) = delete;

 private:
  void work();
  void measureIfDue();
  void checkAndReport();
  void lookForTopics(const InputFacts& input, double age_s);
  double age_s() const { return (ros::WallTime::now() - start_).toSec(); }

  const std::string name_;
  const Sources sources_;
  const ros::WallTime start_;
  ros::Publisher publisher_;
  const TfParents tf_parents_;

  // Used by the thread only.
  DoctorChecks checks_;
  ReportSchedule schedule_;
  StereoMessages last_measured_;
  int num_measured_ = 0;
  double next_measurement_s_ = 0.0;
  std::vector<std::string> image_topics_;
  double next_look_s_ = 0.0;
  LogThrottle log_throttle_;

  std::mutex mutex_;
  std::condition_variable stopping_;
  bool stopped_ = false;  // guarded by mutex_
  std::thread thread_;
};

}  // namespace point_line_odometry
