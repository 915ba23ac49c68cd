#pragma once

#include <cstddef>
#include <deque>
#include <set>
#include <vector>

#include "ros/doctor_checks.h"
#include "ros/doctor_facts.h"
#include "ros/mask_buffer.h"
#include "ros/node_parameters.h"

namespace point_line_odometry {

/// The image sets that a check of limited duration uses.
class DoctorPairs {
 public:
  /// \param kept number of the latest sets that are processed.
  explicit DoctorPairs(std::size_t kept) : kept_(kept) {}

  /// Keeps the latest sets, and some of the first ones to be measured.
  void take(const StereoMessages& set, double time_s);

  /// Of the images of the sets kept.
  std::set<ros::Time> stamps() const;

  /// Adds the masks of the sets kept.
  void addMasks(MaskBuffer* masks);

  /// Measures those kept for it, and follows points through the latest sets.
  void measure(DoctorChecks* checks) const;

  /// Processes the sets kept, and adds the median time for a frame on this computer, without the
  /// first one, what the masks do, and how the IMU's rates fit; nothing if the sets cannot be used.
  void process(const AllParameters& parameters, DoctorFacts* facts) const;

 private:
  std::size_t kept_;
  std::deque<StereoMessages> sets_;
  std::vector<StereoMessages> to_measure_;
  double last_s_ = 0.0;  // of to_measure_
};

}  // namespace point_line_odometry
