#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "point_line_odometry/motion_prior.h"

namespace point_line_odometry {

/// Motion priors by the stamp at which they end.
using PriorsByStamp = std::map<std::int64_t, MotionPrior>;

/// Reads a file with a motion of the left camera (as the trajectory: of the raw one for raw images)
/// in each row: "from_s to_s tx ty tz qx qy qz qw stx sty stz srx sry srz", its pose at the second
/// stamp in that at the first [m], and standard deviations along and about the axes of the first
/// [m, rad]; 0: the axis is unknown. Throws InputError for anything else, also for two rows that
/// end at the same stamp.
PriorsByStamp readPriors(const std::string& file);

/// The stamps of two frames.
struct StampPair {
  std::int64_t from_ns = 0;
  std::int64_t to_ns = 0;
};

/// What became of the rows of a prior file.
struct PriorFileUse {
  std::size_t rows = 0;              ///< of the file, without those of frames that were left out
  std::vector<StampPair> unmatched;  ///< rows that are of no two frames in succession
};

/// A warning that names the rows that matched no frames; none if all did. Throws InputError if no
/// row did. \param frames_ns stamps of the frames.
std::vector<std::string> unmatchedRows(const PriorFileUse& use, const std::string& file,
                                       const std::vector<std::int64_t>& frames_ns);

}  // namespace point_line_odometry
