#pragma once

#include <Eigen/Core>
#include <vector>

#include "common/thread_pool.h"
#include "features/features.h"
#include "map/local_map.h"
#include "matching/appearance_matcher.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "motion/frame_context.h"

namespace point_line_odometry {

/// Known points to match by appearance: element i of both lists is one point.
struct ReferencePoints {
  std::vector<Eigen::Vector3d> positions;  ///< in the earlier camera [m]
  std::vector<StereoDescriptor> descriptors;
};

/// The points of a frame with a depth, or those too far for one.
ReferencePoints referencePoints(const StereoFrame& frame, bool far);

/// The points of a map, in the camera of its previous frame.
ReferencePoints referencePoints(const LocalMap& map);

/// The known points that are found anywhere in a frame, by their appearance alone.
/// \param threads null: none.
std::vector<PointCorrespondence> matchWholeImage(const ReferencePoints& known,
                                                 const StereoFrame& curr,
                                                 const FrameContext& context, ThreadPool* threads);

}  // namespace point_line_odometry
