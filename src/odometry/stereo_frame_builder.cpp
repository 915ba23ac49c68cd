#include "odometry/stereo_frame_builder.h"

#include <algorithm>
#include <iterator>

#include "matching/frame_matcher.h"
#include "odometry/coarser_lines.h"
#include "odometry/stage_timer.h"
#include "odometry/stereo_triangulation.h"

namespace point_line_odometry {
namespace {

/// Adds points and lines of coarser levels where the frame has few points, and the levels
/// themselves also if points of the previous frame are aligned in them.
void addCoarserFeatures(StereoFeatureDetector* detector, const std::optional<TrackingStart>& start,
                        FrameContext* context, ThreadPool* threads, StereoFrame* frame) {
  const PointCoverage coverage(*frame, *context);
  const bool poor = coverage.isPoor();
  if (!poor && !(start && hasCoarserPoints(start->previous))) return;
  addLevels(context, threads);
  std::copy(context->left.levels.begin() + 1, context->left.levels.end(),
            std::back_inserter(frame->left_image.levels));
  if (!poor) return;
  addCoarserLines(detector, *context, threads, frame);
  addCoarserPoints(detector, start, coverage, *context, threads, frame);
}

}  // namespace

void addLevels(FrameContext* context, ThreadPool* threads) {
  threads->run(2, [&](int task) {
    ImagePyramid& image = task == 0 ? context->left : context->right;
    image.addLevels(context->parameters.points);
    (task == 0 ? context->masks.left : context->masks.right).addLevels(image);
  });
}

StereoFrame detectFeatures(StereoFeatureDetector* detector, LineResolution lines,
                           const FrameContext& context, ThreadPool* threads, StageTimes* times) {
  const StageTimer timer(times, Stage::kDetect);
  StereoFrame frame;
  frame.stamp_ns = context.images.stamp_ns;
  frame.left_image = ImagePyramid(context.images.left.clone());
  frame.features = detector->detect(context.images, lines, threads, context.masks);
  return frame;
}

StereoFrame matchFeatures(StereoFrame frame, StereoFeatureDetector* detector,
                          const std::optional<TrackingStart>& start, FrameContext* context,
                          ThreadPool* threads, StageTimes* times) {
  const Parameters& parameters = context->parameters;
  StereoMatches matches;
  {
    const StageTimer timer(times, Stage::kMatchStereo);
    matches = matchStereo(frame.features, context->correction, parameters.matching, threads);
  }
  {
    const StageTimer timer(times, Stage::kTriangulate);
    triangulateMatches(matches, *context, threads, &frame);
  }
  if (parameters.points.enabled && parameters.points.levels > 1) {
    const StageTimer timer(times, Stage::kDetect);
    addCoarserFeatures(detector, start, context, threads, &frame);
  }
  return frame;
}

}  // namespace point_line_odometry
