#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <tuple>
#include <vector>

#include "features/line_feature_detector.h"
#include "motion/frame_intervals.h"
#include "motion/noise_scale.h"
#include "motion/online_stereo_calibration.h"
#include "odometry/coarser_points.h"
#include "odometry/frame_shutter.h"
#include "odometry/landmark_frames.h"
#include "odometry/odometry_pose.h"
#include "odometry/prior_chain.h"
#include "odometry/repeated_images.h"
#include "odometry/resting_features.h"
#include "odometry/tracking_result.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// A map in which tracking was lost: the camera may be relocalized in it.
struct LostMap {
  FrameHistory history;  ///< with a map
  MapAnchor anchor;
  std::int64_t tried_ns = 0;  ///< stamp of the last frame that was tried

  auto state() {
    auto& [history_of_this, anchor_of_this, tried] = *this;
    return std::tie(history_of_this, anchor_of_this, tried);
  }
};

/// Whether a lost map is older than tracking/relocalization_s.
bool isExpired(const LostMap& lost, std::int64_t stamp_ns, const TrackingParameters& parameters);

/// Whether the stereo calibration is refined: small displacements are measurable with sub-pixels
/// only.
bool calibratesStereo(const Parameters& parameters);

/// By how much all disparities differ with another correction, as a mean over the image [px].
double commonDifference(const StereoCorrection& a, const StereoCorrection& b,
                        const StereoCamera& camera);

/// A difference with which landmarks are wrong: three standard deviations of a calibrated camera's.
constexpr double kOtherDisparityPx = 3.0 * StereoCorrection::kCalibratedPx;

/// The state between frames. A value: it is copied, assigned and saved as a whole.
struct OdometryState {
  TrackingState tracking = TrackingState::kInitializing;
  std::optional<std::int64_t> stamp_ns;  ///< of the last accepted frame
  FrameIntervals intervals;              ///< of the accepted frames
  FrameHistory history;                  ///< previous frames and the map
  std::optional<LostMap> lost;
  OdometryPose pose;
  OnlineStereoCalibration stereo_calibration;
  FrameShutter shutter;
  NoiseScale noise;
  PriorChain priors;
  RestingFeatures resting;  ///< on the robot's own body
  RepeatedImages repeated;
  LandmarkFrames landmark_frames;
  int failed_windows = 0;  ///< not yet reported by a frame

  /// Before the first frame. \param camera of the images as they are processed.
  explicit OdometryState(const StereoCamera& camera,
                         const Eigen::Isometry3d& T_odom_camera = Eigen::Isometry3d::Identity())
      : pose(T_odom_camera), stereo_calibration(camera), resting(camera) {}

  /// Update by the tracking result of a frame: pose, noise, calibration, landmarks.
  /// \param curr becomes the previous frame, if it can be. \param prior of its motion.
  void update(StereoFrame curr, const FrameContext& context, const TrackingResult& tracked,
              const FramePrior& prior, ThreadPool* threads, StageTimes* times);

  /// How the prior of a frame (null: none) may be used.
  FramePrior prepare(const MotionPrior* prior, std::int64_t stamp_ns) const;

  /// From where the points of a new frame are tracked; nothing without a previous frame.
  std::optional<TrackingStart> trackingStart(const FrameContext& context,
                                             const FramePrior& prior) const;

  /// The velocity that predicts the motion of a frame since the previous one: OdometryPose's, or
  /// the mean of what is known of that motion and of the rest at that velocity.
  std::optional<CameraVelocity> velocityFor(const FrameContext& context) const;

  /// At which size lines are looked for in a frame: coarse to fine where points are many, and
  /// motions are known up to the last frame and for some frames before.
  LineResolution lineResolution(const FrameContext& context) const;

  /// Whether the next frame may be tracked by landmarks alone: motions are known up to the last
  /// frame and for some frames before, and features were detected not too long ago.
  bool mayTrackLandmarks(const FrameContext& context) const;

  /// From the last accepted frame [s]; 0 for the very first one.
  double sinceLast(const FrameContext& context) const;

  /// Whether a pair has an image of the previous frame again, see RepeatedImages. After a gap a
  /// camera of which no noise is known may have stood still.
  bool repeatsImages(const FrameContext& context, const FramePrior& prior) const;

  /// A frame with this stamp is accepted.
  void noteStamp(std::int64_t curr_stamp_ns);

  /// Predicts the pose of a frame that could not be processed; the previous frame remains.
  void predict(std::int64_t curr_stamp_ns, const TrackingParameters& parameters,
               const FramePrior& prior);

  /// Leaves features out of the previous frame by which a camera that moves seems to be stationary,
  /// and drops the map and the velocity, which are theirs; the current frame is to be tracked
  /// again. False if there are none, or none is certain yet: then other motions are covered.
  /// \param tracked of the current frame.
  bool leaveOutResting(const StereoFrame& curr, const FrameContext& context, ThreadPool* threads,
                       TrackingResult* tracked);

  /// Makes a motion ambiguous that may as well be another one: that of a scene behind a body which
  /// is not certain yet, or an unknown one where the scene may be hidden, or the matches of a
  /// motion without a velocity agree by chance. The latter two not where a prior knows the motion.
  void coverOtherMotions(const std::optional<RestingBody>& body, const FrameContext& context,
                         TrackingResult* tracked) const;

  /// The same where neither a velocity nor a prior supports the motion, and many matches disagree
  /// with it, or nearly as many agree with another, or it may be to another place. Not before a
  /// knocked camera is corrected, with which matches disagree, too.
  void coverUnsupportedMotion(const FramePrior& prior, const FrameContext& context,
                              TrackingResult* tracked) const;

  /// Whether a motion may be to another place that looks alike: there was none for longer than
  /// tracking/max_frame_gap_s, and half of the usual share of landmarks is not found (where none
  /// are expected yet, half of the features).
  bool mayBeOtherPlace(const FrameContext& context, const TrackingResult& tracked) const;

  /// The rolling shutter of a frame before its motion is known, and by its motion.
  RollingShutter predictedShutter(const FrameContext& context) const;
  RollingShutter measuredShutter(const TrackingResult& tracked, const FrameContext& context) const;

  /// Locates the previous frame, whose own motion was not known, with the velocity of the context's
  /// rolling shutter.
  void locateInMotion(const FrameContext& context);

  /// The correction of the right image as a frame and its motion will leave it.
  StereoCorrection correctionBy(const StereoFrame& curr,
                                const std::optional<CalibrationEvidence>& motion,
                                const Parameters& parameters) const;

  /// Locates the previous frame again with the context's correction, and drops the map and the lost
  /// one.
  void locateAgain(const FrameContext& context);

  /// The same if it is located with another correction.
  void followCorrection(const FrameContext& context);

  /// Restores the lost map, in which the camera was relocalized.
  void returnToLostMap();

  /// The next frame is the first one of a new map; pose and calibration are kept.
  void restartTracking();

  /// Likewise at another pose, and of any stamp.
  void continueAt(const Eigen::Isometry3d& T_odom_camera);

  /// Discards the landmarks; tracking continues from the previous frame.
  void restartMap(const Parameters& parameters);

  auto state() {
    auto& [tracking_of_this, stamp, intervals_of_this, history_of_this, lost_of_this, pose_of_this,
           calibration, shutter_of_this, noise_of_this, priors_of_this, resting_of_this,
           repeated_of_this, landmark_frames_of_this, failed] = *this;
    return std::tie(tracking_of_this, stamp, intervals_of_this, history_of_this, lost_of_this,
                    pose_of_this, calibration, shutter_of_this, noise_of_this, priors_of_this,
                    resting_of_this, repeated_of_this, landmark_frames_of_this, failed);
  }

 private:
  std::optional<CameraVelocity> velocityAtPrevious(const FrameContext& context) const;
  void locatePrevious(const FrameContext& context);
  void updateShutter(const TrackingResult& tracked, bool is_known, const FrameContext& context,
                     StereoFrame* curr);
  void updateCalibration(const TrackingResult& tracked,
                         const std::vector<OnlineStereoCalibration::VerticalDisparity>& vertical,
                         double noise_px);
  bool spansGap(const FrameContext& context) const;
  void updatePrevious(StereoFrame curr, const FrameContext& context, const TrackingResult& tracked,
                      ThreadPool* threads);
  void keepLostMap(const Parameters& parameters);
  void startMap(const Parameters& parameters);
  bool predicts(const FrameContext& context) const;
  void coverUnknownMotion(const MotionPrior* prior, const FrameContext& context,
                          TrackingResult* tracked) const;
};

}  // namespace point_line_odometry
