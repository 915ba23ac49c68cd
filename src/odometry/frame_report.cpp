#include "odometry/frame_report.h"

#include <vector>

#include "geometry/triangulation.h"
#include "motion/residuals.h"
#include "odometry/stereo_triangulation.h"

namespace point_line_odometry {
namespace {

/// Numbers of detected, stereo-matched and untriangulable features.
FrameCounts countFeatures(const StereoFrame& frame) {
  FrameCounts counts;
  counts.points_left = static_cast<int>(frame.features.points_left.size());
  counts.points_right = static_cast<int>(frame.features.points_right.size());
  counts.lines_left = static_cast<int>(frame.features.lines_left.size());
  counts.lines_right = static_cast<int>(frame.features.lines_right.size());
  counts.point_stereo_matches = static_cast<int>(frame.points.size());
  counts.line_stereo_matches = static_cast<int>(frame.lines.size());
  for (const StereoLine& line : frame.lines)
    counts.lines_not_triangulable += line.triangulated ? 0 : 1;
  return counts;
}

/// That of the correspondences.
const MotionEstimate& motionOf(const TrackingResult& tracked) {
  return tracked.by_landmarks ? tracked.motion : tracked.frame_to_frame;
}

/// By a map, or by the last frame before tracking was lost.
bool wasRelocalized(const OdometryState& state, const TrackingResult& tracked) {
  const bool measured = tracked.reason == TrackingReason::kNone && !tracked.ambiguous;
  return tracked.relocalized || (measured && state.tracking == TrackingState::kLost &&
                                 state.history.previous->stamp_ns < *state.stamp_ns);
}

FrameCounts countTracked(const OdometryState& state, const StereoFrame& curr,
                         const TrackingResult& tracked) {
  FrameCounts counts = countFeatures(curr);
  const Correspondences& matches_of_motion = tracked.correspondences;
  const MotionEstimate& motion = motionOf(tracked);
  counts.point_matches = static_cast<int>(matches_of_motion.points.size());
  counts.line_matches = static_cast<int>(matches_of_motion.lines.size());
  counts.point_inliers = motion.num_point_inliers;
  counts.line_inliers = motion.num_line_inliers;
  counts.iterations = tracked.motion.iterations;
  counts.relocalizations = wasRelocalized(state, tracked) ? 1 : 0;
  counts.failed_windows = state.failed_windows;
  if (!state.history.map) return counts;
  const LocalMap& map = *state.history.map;
  const LandmarkMatches& matches = tracked.landmark_matches;
  counts.map_points = static_cast<int>(map.numPoints());
  counts.map_lines = static_cast<int>(map.numLines());
  counts.map_point_inliers = countInliers(tracked.motion.point_inliers, matches.points.size());
  counts.map_line_inliers = countInliers(tracked.motion.line_inliers, matches.lines.size());
  counts.keyframes = static_cast<int>(map.numKeyframes());
  return counts;
}

/// Of a match by the motion; zero if it is no inlier.
Eigen::Vector3f residualOf(const TrackingResult& tracked, const StereoCamera& camera,
                           std::size_t match) {
  const MotionEstimate& motion = motionOf(tracked);
  if (!motion.point_inliers[match]) return Eigen::Vector3f::Zero();
  const PointResidual<ResidualImages::kBoth> residual(tracked.correspondences.points[match], camera,
                                                      motion.T_curr_prev);
  return residual.valid ? residual.value.cast<float>() : Eigen::Vector3f::Zero().eval();
}

/// The landmarks by which a frame was tracked, located by their pixels in this frame, of which the
/// stereo correction is taken back.
void observeLandmarks(const FrameContext& context, const TrackingResult& tracked,
                      FrameResult* result) {
  const StereoCorrection& correction = context.correction;
  const std::vector<PointCorrespondence>& points = tracked.correspondences.points;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d right_px = correction.remove(points[i].right_px);
    const double disparity_px = points[i].left_px.x() - points[i].right_px.x();
    if (!(disparity_px > 0.0)) continue;
    result->points.push_back(
        {points[i].left_px.cast<float>(), right_px.cast<float>(),
         backProject(context.camera, points[i].left_px, disparity_px).cast<float>(),
         bool(tracked.motion.point_inliers[i]), residualOf(tracked, context.camera, i),
         static_cast<float>(right_px.y() - points[i].left_px.y())});
  }
  const std::vector<LineCorrespondence>& lines = tracked.correspondences.lines;
  const auto segment = [](const Eigen::Vector2d& start, const Eigen::Vector2d& end) {
    return LineSegment{start.cast<float>(), end.cast<float>()};
  };
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const std::optional<TriangulatedLine> line = triangulateObservation(lines[i], context);
    if (!line) continue;
    result->lines.push_back({segment(lines[i].left_start_px, lines[i].left_end_px),
                             segment(correction.remove(lines[i].right_start_px),
                                     correction.remove(lines[i].right_end_px)),
                             line->start_camera.cast<float>(), line->end_camera.cast<float>(),
                             bool(tracked.motion.line_inliers[i])});
  }
}

/// Since the last frame, where that was tracked by landmarks, else since the previous one.
std::optional<ImageMotion> imageMotionSinceLast(const OdometryState& state,
                                                const TrackingResult& tracked) {
  if (!tracked.image_motion || !state.landmark_frames.motion()) return tracked.image_motion;
  const ImageMotion& last = *state.landmark_frames.motion();
  const ImageMotion& curr = *tracked.image_motion;
  return ImageMotion{*state.stamp_ns, last.T_prev_curr.inverse() * curr.T_prev_curr,
                     covarianceBetween(last.T_prev_curr, last.covariance, curr.covariance)};
}

/// The features of the frame for display: matched ones with their positions, and the others.
void observeFeatures(const StereoFrame& curr, const StereoCamera& camera,
                     const TrackingResult& tracked, FrameResult* result) {
  const CircularMatches& matches = tracked.matches;
  const MotionEstimate& motion = tracked.frame_to_frame;
  std::vector<bool> point_shown(curr.features.points_left.size(), false);
  std::vector<bool> line_shown(curr.features.lines_left.size(), false);
  for (std::size_t i = 0; i < matches.points.size(); ++i) {
    const StereoPoint& point = curr.points[matches.points[i].second];
    point_shown[point.left] = true;
    if (point.far) continue;  // its depth is unknown
    const Eigen::Vector2f& left_px = curr.features.points_left[point.left].pixel;
    result->points.push_back({left_px, curr.features.points_right[point.right].pixel,
                              point.triangulated.p_camera.cast<float>(),
                              bool(motion.point_inliers[i]), residualOf(tracked, camera, i),
                              point.right_px.y() - left_px.y()});
  }
  for (std::size_t i = 0; i < matches.lines.size(); ++i) {
    const StereoLine& line = curr.lines[matches.lines[i].second];
    if (!line.triangulated) continue;
    line_shown[line.left] = true;
    result->lines.push_back(
        {curr.features.lines_left[line.left].segment, curr.features.lines_right[line.right].segment,
         line.triangulated->start_camera.cast<float>(), line.triangulated->end_camera.cast<float>(),
         bool(motion.line_inliers[i])});
  }
  for (std::size_t i = 0; i < point_shown.size(); ++i) {
    if (!point_shown[i]) result->unmatched_points_px.push_back(curr.features.points_left[i].pixel);
  }
  for (std::size_t i = 0; i < line_shown.size(); ++i) {
    if (!line_shown[i]) result->unmatched_lines_px.push_back(curr.features.lines_left[i].segment);
  }
}

}  // namespace

TrackingReason refusal(const StereoImages& images, const StereoCamera& camera,
                       const std::optional<std::int64_t>& last_stamp_ns) {
  const auto fits = [&](const cv::Mat& image) {
    return image.type() == CV_8UC1 && image.cols == camera.width && image.rows == camera.height;
  };
  const auto maskFits = [&](const cv::Mat& mask) { return mask.empty() || fits(mask); };
  if (!fits(images.left) || !fits(images.right) || !maskFits(images.left_mask) ||
      !maskFits(images.right_mask))
    return TrackingReason::kWrongImages;
  if (last_stamp_ns && images.stamp_ns <= *last_stamp_ns) return TrackingReason::kStampNotNewer;
  return TrackingReason::kNone;
}

void reportTracking(const OdometryState& state, const StereoFrame& curr,
                    const FrameContext& context, const TrackingResult& tracked,
                    FrameResult* result) {
  result->reason = tracked.weak ? TrackingReason::kWeakMotion : tracked.reason;
  if (tracked.ambiguous) result->reason = TrackingReason::kAmbiguousMotion;
  result->rms_px = tracked.motion.rms_px;
  result->point_residuals = tracked.motion.point_residuals;
  result->line_residuals = tracked.motion.line_residuals;
  result->counts = countTracked(state, curr, tracked);
  result->by_landmarks = tracked.by_landmarks;
  if (!tracked.in_lost_map) result->image_motion = imageMotionSinceLast(state, tracked);
  if (tracked.by_landmarks) {
    observeLandmarks(context, tracked, result);
  } else {
    observeFeatures(curr, context.camera, tracked, result);
  }
}

PriorReport reportPrior(const OdometryState& state, const TrackingResult& tracked,
                        const FramePrior& prior) {
  PriorReport report = tracked.prior;
  if (tracked.relocalized) return report;
  const bool measured = tracked.reason == TrackingReason::kNone;
  if (report.use == PriorUse::kNone || (report.use == PriorUse::kUsed && !measured))
    report.use = prior.use;
  if (report.use != PriorUse::kUsed || measured) return report;
  const bool predicted = state.tracking == TrackingState::kDegraded;
  report.use = predicted ? PriorUse::kCarried : PriorUse::kNone;
  return report;
}

}  // namespace point_line_odometry
