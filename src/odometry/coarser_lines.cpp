#include "odometry/coarser_lines.h"

#include <algorithm>
#include <vector>

#include "common/segment_distance.h"
#include "matching/frame_matcher.h"
#include "matching/line_matcher.h"
#include "odometry/stereo_triangulation.h"

namespace point_line_odometry {
namespace {

/// Whether at least half of a segment lies within a distance of others.
bool isCovered(const LineSegment& segment, const std::vector<LineSegment>& others,
               float max_distance_px) {
  constexpr int kSamples = 16;
  int covered = 0;
  for (int i = 0; i < kSamples; ++i) {
    const float t = (static_cast<float>(i) + 0.5F) / kSamples;
    const Eigen::Vector2f p = segment.start + t * (segment.end - segment.start);
    covered += std::any_of(others.begin(), others.end(), [&](const LineSegment& other) {
      return distanceToSegment(other.start, other.end, p) <= max_distance_px;
    });
  }
  return 2 * covered >= kSamples;
}

/// The left segments of the frame's stereo lines.
std::vector<LineSegment> segmentsOf(const StereoFrame& frame) {
  std::vector<LineSegment> segments;
  for (const StereoLine& line : frame.lines)
    segments.push_back(frame.features.lines_left[line.left].segment);
  return segments;
}

/// Drops the last of the lines to be added to others, the shortest, so that there are
/// lines/max_count at most.
void limit(std::size_t num_others, const LineParameters& parameters,
           std::vector<LineFeature>* lines) {
  const auto max_count = static_cast<std::size_t>(parameters.max_count);
  lines->resize(std::min(lines->size(), max_count - std::min(num_others, max_count)));
}

}  // namespace

void addCoarserLines(StereoFeatureDetector* detector, const FrameContext& context,
                     ThreadPool* threads, StereoFrame* frame) {
  DetectedFeatures found =
      detector->detectCoarserLines(context.left, context.right, threads, context.masks);
  const std::vector<LineSegment> known = segmentsOf(*frame);
  const auto is_known = [&](const LineFeature& line) {
    return isCovered(line.segment, known, line.scale);
  };
  found.lines_left.erase(std::remove_if(found.lines_left.begin(), found.lines_left.end(), is_known),
                         found.lines_left.end());
  std::vector<LineFeature>& left = frame->features.lines_left;
  std::vector<LineFeature>& right = frame->features.lines_right;
  limit(left.size(), context.parameters.lines, &found.lines_left);
  limit(right.size(), context.parameters.lines, &found.lines_right);
  std::vector<IndexPair> matches =
      matchLinesStereo(found.lines_left, onCorrectRows(found.lines_right, context.correction),
                       context.parameters.matching, threads);
  for (IndexPair& match : matches) {
    match.first += static_cast<int>(left.size());
    match.second += static_cast<int>(right.size());
  }
  left.insert(left.end(), found.lines_left.begin(), found.lines_left.end());
  right.insert(right.end(), found.lines_right.begin(), found.lines_right.end());
  triangulateLines(matches, context, frame);
}

}  // namespace point_line_odometry
