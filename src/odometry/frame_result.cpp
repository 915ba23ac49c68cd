#include "point_line_odometry/frame_result.h"

namespace point_line_odometry {

const char* toString(TrackingState state) {
  switch (state) {
    case TrackingState::kInitializing:
      return "initializing";
    case TrackingState::kOk:
      return "ok";
    case TrackingState::kDegraded:
      return "degraded";
    case TrackingState::kLost:
      return "lost";
  }
  return "unknown";
}

const char* toString(TrackingReason reason) {
  switch (reason) {
    case TrackingReason::kNone:
      return "none";
    case TrackingReason::kFirstFrame:
      return "first_frame";
    case TrackingReason::kStampNotNewer:
      return "stamp_not_newer";
    case TrackingReason::kWrongImages:
      return "wrong_images";
    case TrackingReason::kFrameGap:
      return "frame_gap";
    case TrackingReason::kRepeatedImages:
      return "repeated_images";
    case TrackingReason::kTooFewFeatures:
      return "too_few_features";
    case TrackingReason::kTooFewMatches:
      return "too_few_matches";
    case TrackingReason::kSolverFailed:
      return "solver_failed";
    case TrackingReason::kTooFewInliers:
      return "too_few_inliers";
    case TrackingReason::kTooFast:
      return "too_fast";
    case TrackingReason::kWeakMotion:
      return "weak_motion";
    case TrackingReason::kAmbiguousMotion:
      return "ambiguous_motion";
    case TrackingReason::kException:
      return "exception";
  }
  return "unknown";
}

const char* toString(Stage stage) {
  switch (stage) {
    case Stage::kDetect:
      return "detect";
    case Stage::kMatchStereo:
      return "match_stereo";
    case Stage::kTriangulate:
      return "triangulate";
    case Stage::kMatchCircular:
      return "match_circular";
    case Stage::kEstimate:
      return "estimate";
    case Stage::kTwoFrames:
      return "two_frames";
    case Stage::kFuse:
      return "fuse";
    case Stage::kWindow:
      return "window";
    case Stage::kMap:
      return "map";
    case Stage::kUpdateMap:
      return "update_map";
    case Stage::kRefine:
      return "refine";
    case Stage::kNumStages:
      break;
  }
  return "unknown";
}

}  // namespace point_line_odometry
