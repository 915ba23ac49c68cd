#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "point_line_odometry/calibration_refinement.h"
#include "point_line_odometry/features.h"
#include "point_line_odometry/motion.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// How far the pose can be trusted.
enum class TrackingState {
  kInitializing,  ///< the first frame: pose known by definition, no motion yet
  kOk,            ///< motion measured
  kDegraded,      ///< motion, or some of its axes, predicted from the velocity
  kLost           ///< no measurement for longer than the prediction may last: the pose is held
};

/// Why the state is not kOk.
enum class TrackingReason {
  kNone,
  kFirstFrame,
  kStampNotNewer,  ///< frame dropped, nothing changed
  kWrongImages,  ///< empty, of another type or size than the camera; frame dropped, nothing changed
  kFrameGap,     ///< too long since the last frame: new reference
  kTooFewFeatures,
  kTooFewMatches,
  kSolverFailed,
  kTooFewInliers,
  kTooFast,
  kWeakMotion,  ///< along some axis the prediction knows the motion better, and it is used there
  kException    ///< something was thrown while the frame was processed; see FrameResult::error
};

const char* toString(TrackingState state);
const char* toString(TrackingReason reason);

/// Stages whose time is taken, in the order of their work; kTwoFrames runs beside kMatchCircular
/// and kEstimate if there is a thread for it. The window's adjustment runs beside the next frame's
/// first stages: kWindow is the time for which that frame waits for it. kNumStages counts them.
enum class Stage {
  kDetect,
  kMatchStereo,
  kTriangulate,
  kMatchCircular,  ///< and the sub-pixel places of the matches
  kEstimate,
  kTwoFrames,  ///< matches with frame k-2 and estimate from them
  kFuse,
  kWindow,
  kMap,     ///< landmarks found again, and the motion against them
  kRefine,  ///< of the calibration
  kLearn,   ///< the map learns from the frame
  kNumStages
};
constexpr int kNumStages = static_cast<int>(Stage::kNumStages);

/// Lower-case name, as in the columns of frames.csv.
const char* toString(Stage stage);

/// Time per stage of one frame [ms].
struct StageTimes {
  std::array<double, kNumStages> ms{};
  double total_ms = 0.0;

  double operator[](Stage stage) const { return ms[static_cast<std::size_t>(stage)]; }
};

/// How many features survived each stage of one frame.
struct FrameCounts {
  int points_left = 0;
  int points_right = 0;
  int lines_left = 0;
  int lines_right = 0;
  int point_stereo_matches = 0;
  int line_stereo_matches = 0;
  int point_matches = 0;  ///< circular
  int line_matches = 0;   ///< circular
  int lines_not_triangulable =
      0;  ///< circular matches too near to the epipolar direction, or at infinity
  int point_inliers = 0;
  int line_inliers = 0;
  int iterations = 0;
  int map_points = 0;  ///< landmarks known before the frame
  int map_lines = 0;
  int map_point_inliers = 0;  ///< landmarks that the pose comes from
  int map_line_inliers = 0;
  int keyframes = 0;
  int failed_windows = 0;   ///< ended without a solution since the last frame
  int relocalizations = 0;  ///< 1 if the camera was found again after its way was lost
};

/// A matched point, in the current left camera.
struct ObservedPoint {
  Eigen::Vector2f left_px = Eigen::Vector2f::Zero();
  Eigen::Vector2f right_px = Eigen::Vector2f::Zero();
  Eigen::Vector3f p_camera = Eigen::Vector3f::Zero();  ///< [m]
  bool inlier = false;
};

/// A matched segment, in the current left camera.
struct ObservedLine {
  LineSegment left_px;
  LineSegment right_px;
  Eigen::Vector3f start_camera = Eigen::Vector3f::Zero();  ///< [m]
  Eigen::Vector3f end_camera = Eigen::Vector3f::Zero();    ///< [m]
  bool inlier = false;
};

/// Everything that is known after a frame.
struct FrameResult {
  std::int64_t stamp_ns = 0;
  TrackingState state = TrackingState::kInitializing;
  TrackingReason reason = TrackingReason::kFirstFrame;
  /// Pose of the rectified left camera in the frame in which it was at the first frame (or as set
  /// by reset()). Always finite. It never jumps: the error of a prediction, or a large correction
  /// by the landmarks, is taken up by and by.
  Eigen::Isometry3d T_odom_camera = Eigen::Isometry3d::Identity();
  /// The same without that care: it jumps where the camera is found again.
  Eigen::Isometry3d T_odom_estimate = Eigen::Isometry3d::Identity();
  Matrix6d pose_covariance =
      Matrix6d::Zero();  ///< of T_odom_camera, along and about the axes of odom
  /// Velocity of the camera in its own axes: linear [m/s], angular [rad/s].
  Vector6d twist = Vector6d::Zero();
  Matrix6d twist_covariance = Matrix6d::Zero();
  /// How long before this frame the one was taken that the twist was measured against [s]; 0 if it
  /// was not measured.
  double twist_over_s = 0.0;
  double rms_px = 0.0;                ///< of the inliers' residuals
  ResidualHistogram point_residuals;  ///< of the inliers, over their standard deviations
  ResidualHistogram line_residuals;
  std::string error;  ///< text of the exception of kException
  FrameCounts counts;
  StageTimes times;
  std::vector<ObservedPoint> points;
  std::vector<ObservedLine> lines;
  std::vector<Eigen::Vector2f> unmatched_points_px;  ///< detected in the left image, not matched
  std::vector<LineSegment> unmatched_lines_px;       ///< the same for segments

  /// False for a frame that was dropped without changing anything.
  bool accepted() const {
    return reason != TrackingReason::kStampNotNewer && reason != TrackingReason::kWrongImages;
  }
};

/// The pipeline: one call per stereo frame. Deterministic; not thread-safe; no ROS.
class StereoOdometry {
 public:
  /// Throws std::invalid_argument if the camera or a parameter is out of its range (all bad ones
  /// are named).
  StereoOdometry(const StereoCamera& camera, const Parameters& parameters);
  ~StereoOdometry();
  StereoOdometry(StereoOdometry&&) noexcept;
  StereoOdometry& operator=(StereoOdometry&&) noexcept;

  /// Estimates the motion since the last frame and integrates it. Bad data gives a state and
  /// reason, never an exception, and so does whatever is thrown on the way.
  FrameResult process(const StereoImages& images);

  /// Forgets the past; the next frame is the first one, and has this pose.
  void reset(const Eigen::Isometry3d& T_odom_camera = Eigen::Isometry3d::Identity());

  /// Takes another calibration: new reference, pose and covariance kept.
  void setCamera(const StereoCamera& camera);

  /// Takes other parameters from the next frame on; the motion goes on, landmarks are kept unless
  /// `window` or `local_map` changes. Another size of images (`tracking/max_megapixels`) or
  /// `points/descriptor` is a new reference: the pose is kept. Throws like the constructor, and
  /// changes nothing then.
  void setParameters(const Parameters& parameters);

  /// All that earlier frames have left for the next ones, as bytes: after a hundred frames of KITTI
  /// 8 MB in 2 ms. Waits for the window's adjustment, for which the next frame would wait.
  std::string saveState();

  /// Goes on from where saveState() was called: with the same camera and parameters, the same
  /// images give the same bits, by the same version of this library on the same kind of computer.
  /// Throws std::invalid_argument, and is as after reset(), if the bytes are not complete or of
  /// another layout; numbers are not checked beyond that.
  void restoreState(const std::string& bytes);

  const StereoCamera& camera() const;
  const Parameters& parameters() const;

  /// What finds the segments: what lines/detector asks for, or what stands in its place.
  LineDetectorKind lineDetector() const;

  /// Displacement of the right image against its calibration, as estimated so far; in pixels of the
  /// images as they are processed (tracking/max_megapixels).
  const RightImageCorrection& correction() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace point_line_odometry
