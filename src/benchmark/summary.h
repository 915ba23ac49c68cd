#pragma once

#include <string>
#include <vector>

#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// What a summary is made of.
struct SummaryOptions {
  std::vector<std::string> sequences;  ///< folders; one of each size of images is used
  std::size_t frames = 50;             ///< of each sequence, at most
  double drive_m = 0.0;                ///< length of the drive for its memory; 0: none
  Parameters parameters;               ///< but for tracking/threads, which is set
};

/// The speed of the whole odometry as tables in Markdown. For a KITTI camera and for a EuRoC
/// camera, on the built-in world where no sequence of that size is given: time of a frame on two
/// threads, on one, and on as many as there are cores, in turns with OpenCV's line segment detector
/// and relative to it, with the goals and the times of other systems; its spread, processor time,
/// memory, larger images; times of the stages and how they scale with threads. Writes notes to
/// stderr. Throws InputError for sequences that cannot be used. To be called while the process has
/// one thread.
std::string summarize(const SummaryOptions& options);

}  // namespace point_line_odometry
