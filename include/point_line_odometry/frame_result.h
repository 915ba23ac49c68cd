#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/residual_histogram.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// How far the pose can be trusted.
enum class TrackingState {
  kInitializing,  ///< the very first frame: pose known by definition, no motion yet
  kOk,            ///< motion estimated from the images
  kDegraded,      ///< motion, or some of its axes, predicted from the velocity or a prior
  kLost           ///< no estimate for longer than the prediction may last: the pose is kept
};

/// Why the state is not kOk.
enum class TrackingReason {
  kNone,
  kFirstFrame,
  kStampNotNewer,   ///< frame dropped, nothing changed
  kWrongImages,     ///< they or their masks are of another type or size than the camera's; frame
                    ///< dropped, nothing changed
  kFrameGap,        ///< too long since the last frame, and the images do not show the motion:
                    ///< tracking starts again
  kRepeatedImages,  ///< an image of the previous frame again, byte for byte: its driver repeats it
  kTooFewFeatures,
  kTooFewMatches,
  kSolverFailed,
  kTooFewInliers,
  kTooFast,
  kWeakMotion,       ///< fused with the prediction, which constrains some axes better
  kAmbiguousMotion,  ///< the features found may be the robot's own body, those of another place, or
                     ///< agree by chance or as structure that repeats itself
  kException         ///< something was thrown while the frame was processed; see FrameResult::error
};

/// Lower-case name, as in frames.csv.
const char* toString(TrackingState state);
/// Lower-case name, as in frames.csv and OdometryInfo; "none" for kNone.
const char* toString(TrackingReason reason);

/// Stages whose time is taken, in the order in which they run; kTwoFrames runs in parallel to
/// kMatchCircular and kEstimate if there is a thread for it. The window's bundle adjustment runs in
/// parallel to the next frame's first stages: kWindow is the time for which that frame waits for
/// it.
enum class Stage {
  kDetect,
  kMatchStereo,
  kTriangulate,
  kMatchCircular,  ///< and the sub-pixel alignment of the matches
  kEstimate,
  kTwoFrames,  ///< matches with frame k-2 and estimate from them
  kFuse,
  kWindow,
  kMap,        ///< landmarks matched, and the motion estimated against them
  kRefine,     ///< online stereo calibration
  kUpdateMap,  ///< landmarks updated, added and culled
  kNumStages
};
/// Number of stages.
constexpr int kNumStages = static_cast<int>(Stage::kNumStages);

/// Lower-case name, as in the columns of frames.csv.
const char* toString(Stage stage);

/// Time per stage of one frame [ms].
struct StageTimes {
  std::array<double, kNumStages> ms{};  ///< by stage
  double total_ms = 0.0;                ///< of the whole frame; stages may run in parallel

  /// Of one stage [ms].
  double operator[](Stage stage) const { return ms[static_cast<std::size_t>(stage)]; }
};

/// How many features survived each stage of one frame.
struct FrameCounts {
  int points_left = 0;           ///< detected in the left image; 0 if it was not looked for any
  int points_right = 0;          ///< detected in the right image
  int lines_left = 0;            ///< detected in the left image
  int lines_right = 0;           ///< detected in the right image
  int point_stereo_matches = 0;  ///< pairs (left, right)
  int line_stereo_matches = 0;   ///< pairs (left, right)
  int point_matches = 0;         ///< circular
  int line_matches = 0;          ///< circular
  int lines_not_triangulable =
      0;                  ///< circular matches too near to the epipolar direction, or at infinity
  int point_inliers = 0;  ///< circular matches that agree with the motion
  int line_inliers = 0;   ///< the same for lines
  int iterations = 0;     ///< of the solver
  int map_points = 0;     ///< landmarks known before the frame
  int map_lines = 0;      ///< the same for lines
  int map_point_inliers = 0;  ///< landmarks that the pose is estimated from
  int map_line_inliers = 0;   ///< the same for lines
  int keyframes = 0;          ///< in the window and the local map
  int failed_windows = 0;     ///< bundle adjustments without a solution since the last frame
  int relocalizations = 0;    ///< 1 if the camera was relocalized after tracking was lost
};

/// A matched point, in the current left camera; with a rolling shutter its pixels are those of the
/// images, its position that at the stamp.
struct ObservedPoint {
  Eigen::Vector2f left_px = Eigen::Vector2f::Zero();   ///< pixel in the left image
  Eigen::Vector2f right_px = Eigen::Vector2f::Zero();  ///< pixel in the right image
  Eigen::Vector3f p_camera = Eigen::Vector3f::Zero();  ///< [m]
  bool inlier = false;                                 ///< it agrees with the motion
  /// Reprojection residual of the motion since the previous frame, observed minus projected [px]:
  /// u and v in the left image, u in the right one; zero if it is no inlier.
  Eigen::Vector3f residual_px = Eigen::Vector3f::Zero();
  float vertical_disparity_px = 0.0F;  ///< v in the right image minus v in the left one
};

/// A matched segment, in the current left camera.
struct ObservedLine {
  LineSegment left_px;                                     ///< in the left image
  LineSegment right_px;                                    ///< in the right image
  Eigen::Vector3f start_camera = Eigen::Vector3f::Zero();  ///< [m]
  Eigen::Vector3f end_camera = Eigen::Vector3f::Zero();    ///< [m]
  bool inlier = false;                                     ///< it agrees with the motion
};

/// The motion of a frame by its images alone, without prior and prediction.
struct ImageMotion {
  std::int64_t from_ns = 0;  ///< stamp of the earlier frame that it is since
  Eigen::Isometry3d T_prev_curr = Eigen::Isometry3d::Identity();  ///< of the left camera
  Matrix6d covariance = Matrix6d::Zero();  ///< along and about the axes of the earlier camera
};

/// Everything that is known after a frame.
struct FrameResult {
  std::int64_t stamp_ns = 0;                            ///< of the images
  TrackingState state = TrackingState::kInitializing;   ///< how far to trust the pose
  TrackingReason reason = TrackingReason::kFirstFrame;  ///< why the state is not kOk
  /// Pose of the rectified left camera in the frame in which it was at the first frame (or as set
  /// by reset()). Always finite. It never jumps: the error of a prediction, or a large correction
  /// by the landmarks, is taken up gradually.
  Eigen::Isometry3d T_odom_camera = Eigen::Isometry3d::Identity();
  /// The same without smoothing: it jumps where the camera is relocalized.
  Eigen::Isometry3d T_odom_estimate = Eigen::Isometry3d::Identity();
  Matrix6d estimate_covariance =
      Matrix6d::Zero();  ///< of T_odom_estimate, along and about the axes of odom
  Matrix6d pose_covariance =
      Matrix6d::Zero();  ///< of T_odom_camera, along and about the axes of odom
  /// Velocity of the camera in its own axes: linear [m/s], angular [rad/s].
  Vector6d twist = Vector6d::Zero();
  Matrix6d twist_covariance = Matrix6d::Zero();  ///< in the same axes
  /// Time between the two frames that the twist was estimated from [s]; 0 if it was not estimated.
  double twist_over_s = 0.0;
  PriorReport prior;                        ///< use of the frame's motion prior
  std::optional<ImageMotion> image_motion;  ///< nothing if the images gave none
  /// The frame was tracked by landmarks alone: no features were detected in its images. Its points
  /// and lines, the matches and inliers among its counts, are landmarks; the error of its motion is
  /// not propagated to the next poses.
  bool by_landmarks = false;
  double rms_px = 0.0;                               ///< root mean square of the inliers' residuals
  ResidualHistogram point_residuals;                 ///< of the inliers, in standard deviations
  ResidualHistogram line_residuals;                  ///< the same for lines
  std::string error;                                 ///< text of the exception of kException
  FrameCounts counts;                                ///< of features and landmarks
  StageTimes times;                                  ///< what the frame took
  std::vector<ObservedPoint> points;                 ///< matched with the previous frame
  std::vector<ObservedLine> lines;                   ///< matched with the previous frame
  std::vector<Eigen::Vector2f> unmatched_points_px;  ///< detected in the left image, not matched
  std::vector<LineSegment> unmatched_lines_px;       ///< the same for segments

  /// False for a frame that was dropped without changing anything.
  bool accepted() const {
    return reason != TrackingReason::kStampNotNewer && reason != TrackingReason::kWrongImages;
  }

  /// Whether features were looked for in the images: not in repeated ones.
  bool processed() const { return accepted() && reason != TrackingReason::kRepeatedImages; }
};

}  // namespace point_line_odometry
