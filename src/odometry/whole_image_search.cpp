#include "odometry/whole_image_search.h"

#include <cstddef>

#include "motion/observations.h"

namespace point_line_odometry {

ReferencePoints referencePoints(const StereoFrame& frame, bool far) {
  ReferencePoints known;
  const std::vector<StereoDescriptor> descriptors = stereoDescriptors(frame);
  for (std::size_t i = 0; i < frame.points.size(); ++i) {
    if (frame.points[i].far != far) continue;
    known.descriptors.push_back(descriptors[i]);
    known.positions.push_back(frame.points[i].triangulated.p_camera);
  }
  return known;
}

ReferencePoints referencePoints(const LocalMap& map) {
  ReferencePoints known;
  const Eigen::Isometry3d T_previous_map = map.T_map_previous().inverse();
  for (const MapPoint& point : map.points()) {
    known.descriptors.push_back({point.left, point.right});
    known.positions.push_back(T_previous_map * point.estimate.value);
  }
  return known;
}

std::vector<PointCorrespondence> matchWholeImage(const ReferencePoints& known,
                                                 const StereoFrame& curr,
                                                 const FrameContext& context, ThreadPool* threads) {
  std::vector<PointCorrespondence> points;
  for (const IndexPair& match : matchByAppearance(known.descriptors, stereoDescriptors(curr),
                                                  context.parameters.matching, threads)) {
    const StereoPoint& now = curr.points[match.second];
    points.push_back(
        {pointObservation(curr.features.points_left[now.left].pixel, now.right_px, 1.0, context),
         known.positions[match.first]});
  }
  return points;
}

}  // namespace point_line_odometry
