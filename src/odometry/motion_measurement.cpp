#include "odometry/motion_measurement.h"

#include <algorithm>
#include <cmath>

#include "motion/camera_motion.h"
#include "motion/motion_consensus.h"
#include "odometry/correspondences.h"
#include "odometry/uncertainty.h"

namespace point_line_odometry {
namespace {

constexpr double kMaxWidening = 4.0;  // of the search radius after missing frames

// If the map gives fewer matches than this share of those with the last frame, these are used, too.
constexpr double kFewMapMatches = 0.5;

// Near a prediction that is right, at least this share of the features is found again (0.35 and
// more in all sequences at full rate).
constexpr double kShareFound = 0.25;

// What a place must show of the landmarks to be that where the camera is looked for: so many, and
// so much of the share that is found from frame to frame.
constexpr int kMinRecognised = 20;
constexpr double kShareRecognised = 0.7;
constexpr int kRelocalizationRounds = 2;

/// Appends the matches of one kind that agree with a motion; all of them if there is none.
template <typename Correspondence>
void appendMatches(const std::vector<Correspondence>& matches, const MotionEstimate& motion,
                   const std::vector<bool>& inliers, std::vector<Correspondence>* list) {
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!motion.ok() || inliers[i]) list->push_back(matches[i]);
  }
}

/// Of the features of an earlier frame that should be in view after a motion, the share that was
/// found and agrees with it; 0 without a motion. Far points agree with any translation.
double shareFound(const StereoFrame& earlier, const StereoCamera& camera,
                  const Correspondences& matches, const MotionEstimate& motion) {
  if (!motion.ok()) return 0.0;
  const auto in_view = [&](const Eigen::Vector3d& p_earlier) {
    const Eigen::Vector3d p = motion.T_curr_prev * p_earlier;
    if (!(p.z() > camera.baseline_m)) return false;
    const Eigen::Vector2d left = camera.projectLeft(p);
    return left.x() >= 0.0 && left.y() >= 0.0 && left.x() < camera.width &&
           left.y() < camera.height && camera.projectRight(p).x() >= 0.0;
  };
  const auto points = std::count_if(
      earlier.points.begin(), earlier.points.end(),
      [&](const StereoPoint& point) { return !point.far && in_view(point.triangulated.p_camera); });
  const auto lines =
      std::count_if(earlier.lines.begin(), earlier.lines.end(), [&](const StereoLine& line) {
        return line.triangulated &&
               (in_view(line.triangulated->start_camera) || in_view(line.triangulated->end_camera));
      });
  int far = 0;
  for (std::size_t i = 0; i < matches.points.size(); ++i)
    far += motion.point_inliers[i] && matches.points[i].far ? 1 : 0;
  const auto found = static_cast<double>(motion.num_point_inliers - far + motion.num_line_inliers);
  return found / std::max<double>(1.0, static_cast<double>(points + lines));
}

/// Those whose distance is known.
KnownPoints knownPoints(const StereoFrame& frame) {
  KnownPoints known;
  const std::vector<StereoDescriptor> descriptors = stereoDescriptors(frame);
  for (std::size_t i = 0; i < frame.points.size(); ++i) {
    if (frame.points[i].far) continue;
    known.descriptors.push_back(descriptors[i]);
    known.positions.push_back(frame.points[i].triangulated.p_camera);
  }
  return known;
}

KnownPoints knownPoints(const LocalMap& map) {
  KnownPoints known;
  const Eigen::Isometry3d T_reference_map = map.T_map_reference().inverse();
  for (const MapPoint& point : map.points()) {
    known.descriptors.push_back({point.left, point.right});
    known.positions.push_back(T_reference_map * point.place.value);
  }
  return known;
}

/// True if nearly as many of the landmarks in view are found as in frames that followed each other:
/// another place that looks alike shows only a part of them.
bool isRecognised(const LocalMap& map, const MapSights& sights, const MotionEstimate& motion) {
  return motion.num_point_inliers + motion.num_line_inliers >= kMinRecognised &&
         shareFound(sights, motion) >= kShareRecognised * map.shareFound();
}

TrackingReason trackingReason(MotionStatus status) {
  switch (status) {
    case MotionStatus::kOk:
      return TrackingReason::kNone;
    case MotionStatus::kTooFewMatches:
      return TrackingReason::kTooFewMatches;
    case MotionStatus::kTooFewInliers:
      return TrackingReason::kTooFewInliers;
    case MotionStatus::kSolverFailed:
      break;
  }
  return TrackingReason::kSolverFailed;
}

}  // namespace

MotionMeasurement MotionMeter::measure(const StereoFrame& curr) const {
  const double dt_s = toSeconds(curr.stamp_ns - history_.reference->stamp_ns);
  const MotionPrediction prediction = predict(dt_s);
  MotionMeasurement measurement = measureDirectly(curr, prediction);
  if (history_.map) {
    const StageTimer timer(times_, Stage::kMap);
    measureAgainstMap(curr, prediction, &measurement);
  }
  supportWeakAxes(dt_s, &measurement);
  if (measurement.motion.ok()) {
    measurement.reason = reasonOf(measurement.motion, dt_s);
  } else {
    MotionMeasurement found = relocalize(curr);
    if (found.relocalized) return found;
  }
  return measurement;
}

MotionMeasurement MotionMeter::relocalize(const StereoFrame& curr) const {
  MotionMeasurement measurement;
  measurement.reason = TrackingReason::kTooFewInliers;
  const StageTimer timer(times_, Stage::kMap);
  if (!history_.map || curr.points.size() < kMinConsensus) return measurement;
  const LocalMap& map = *history_.map;
  std::optional<Eigen::Isometry3d> T_curr_reference = searchWidely(knownPoints(map), curr);
  // The consensus knows the pose to a few pixels, at which only some landmarks are found at once.
  for (int round = 0; round < kRelocalizationRounds && T_curr_reference; ++round) {
    measurement.sights =
        map.find(curr, context_, map.T_map_reference() * T_curr_reference->inverse(), threads_);
    measurement.motion = estimateMotion(map.correspondences(measurement.sights), context_.camera,
                                        *T_curr_reference, parameters_.motion);
    T_curr_reference =
        measurement.motion.ok() ? std::make_optional(measurement.motion.T_curr_prev) : std::nullopt;
  }
  if (T_curr_reference && isRecognised(map, measurement.sights, measurement.motion)) {
    const double dt_s = toSeconds(curr.stamp_ns - history_.reference->stamp_ns);
    measurement.reason = reasonOf(measurement.motion, dt_s);
  }
  measurement.relocalized = measurement.reason == TrackingReason::kNone;
  return measurement;
}

/// The estimate over two frames needs nothing of the direct one: they are made side by side.
MotionMeasurement MotionMeter::measureDirectly(const StereoFrame& curr,
                                               const MotionPrediction& prediction) const {
  MotionMeasurement measurement;
  const int few = parameters_.motion.min_matches;
  if (static_cast<int>(curr.points.size() + curr.lines.size()) < few) {
    measurement.reason = TrackingReason::kTooFewFeatures;
    return measurement;
  }
  const Stages direct{Stage::kMatchCircular, Stage::kEstimate};
  MotionEstimate over_two;
  if (history_.before_reference) {
    threads_->run(2, [&](int task) {
      if (task == 0) {
        measurement = measureSince(*history_.reference, curr, prediction, direct, nullptr);
      } else {
        const MotionPrediction since_two_frames{
            prediction.T_curr_prev * history_.before_reference->T_reference_before,
            prediction.radius_px};
        over_two = measureSince(history_.before_reference->frame, curr, since_two_frames,
                                {Stage::kTwoFrames, Stage::kTwoFrames}, nullptr)
                       .direct;
      }
    });
  } else {
    measurement = measureSince(*history_.reference, curr, prediction, direct, threads_);
  }
  measurement.motion = measurement.direct;
  if (measurement.direct.ok() && over_two.ok()) {
    const StageTimer timer(times_, Stage::kFuse);
    measurement.motion = measurement.direct = fuseRotation(
        measurement.direct, over_two.T_curr_prev, history_.before_reference->T_reference_before,
        measurement.correspondences, context_.camera, parameters_.motion);
  }
  measurement.reason = trackingReason(measurement.direct.status);
  return measurement;
}

/// Near the prediction, and where that finds little of what should be seen, in the whole image.
MotionMeasurement MotionMeter::measureSince(const StereoFrame& earlier, const StereoFrame& curr,
                                            const MotionPrediction& prediction,
                                            const Stages& stages, ThreadPool* threads) const {
  MotionMeasurement measurement = measureNear(earlier, curr, prediction, stages, threads);
  if (!parameters_.matching.wide_search) return measurement;
  const double found =
      shareFound(earlier, context_.camera, measurement.correspondences, measurement.direct);
  if (found >= kShareFound) return measurement;
  const std::optional<Eigen::Isometry3d> T_curr_earlier = searchWidely(knownPoints(earlier), curr);
  if (!T_curr_earlier) return measurement;
  MotionMeasurement anew = measureNear(
      earlier, curr, {*T_curr_earlier, parameters_.matching.search_radius_px}, stages, threads);
  const double found_anew = shareFound(earlier, context_.camera, anew.correspondences, anew.direct);
  return found_anew > found ? anew : measurement;
}

/// The motion by which most points that look alike can be explained.
std::optional<Eigen::Isometry3d> MotionMeter::searchWidely(const KnownPoints& known,
                                                           const StereoFrame& curr) const {
  std::vector<PointCorrespondence> points;
  for (const IndexPair& match :
       matchPointsByAppearance(known.descriptors, curr, parameters_.matching)) {
    const StereoPoint& now = curr.points[match.second];
    PointCorrespondence point;
    point.p_prev = known.positions[match.first];
    point.left_px = curr.features.points_left[now.left].pixel.cast<double>();
    point.right_px = context_.correction.apply(now.right_px.cast<double>());
    points.push_back(point);
  }
  const std::optional<MotionConsensus> consensus = findConsensus(points, context_.camera);
  if (!consensus) return std::nullopt;
  return consensus->T_curr_prev;
}

MotionMeasurement MotionMeter::measureNear(const StereoFrame& earlier, const StereoFrame& curr,
                                           const MotionPrediction& prediction, const Stages& stages,
                                           ThreadPool* threads) const {
  MotionMeasurement measurement;
  {
    const StageTimer timer(times_, stages.match);
    measurement.matches =
        matchCircular(earlier, curr, context_.camera, prediction, parameters_.matching);
    measurement.correspondences = makeCorrespondences(earlier, curr, measurement.matches,
                                                      prediction.T_curr_prev, context_, threads);
  }
  const StageTimer timer(times_, stages.estimate);
  measurement.direct = estimate(measurement.correspondences, prediction.T_curr_prev, earlier, curr);
  return measurement;
}

/// The direct motion says where the landmarks are expected; they say where the camera is.
void MotionMeter::measureAgainstMap(const StereoFrame& curr, const MotionPrediction& prediction,
                                    MotionMeasurement* measurement) const {
  const Eigen::Isometry3d& T_curr_reference =
      measurement->direct.ok() ? measurement->direct.T_curr_prev : prediction.T_curr_prev;
  measurement->sights = history_.map->find(
      curr, context_, history_.map->T_map_reference() * T_curr_reference.inverse(), threads_);
  Correspondences matches = history_.map->correspondences(measurement->sights);
  const Correspondences& direct = measurement->correspondences;
  const auto size = [](const Correspondences& c) {
    return static_cast<double>(c.points.size() + c.lines.size());
  };
  if (size(matches) < kFewMapMatches * size(direct)) {
    const MotionEstimate& motion = measurement->direct;
    appendMatches(direct.points, motion, motion.point_inliers, &matches.points);
    appendMatches(direct.lines, motion, motion.line_inliers, &matches.lines);
  }
  const MotionEstimate motion = estimate(matches, T_curr_reference, *history_.reference, curr);
  if (motion.ok()) {
    measurement->motion = motion;
  } else {
    measurement->sights.points.clear();
    measurement->sights.lines.clear();
  }
}

/// Only a prediction from a velocity can tell the camera's motion from that of what it sees.
MotionEstimate MotionMeter::estimate(const Correspondences& matches,
                                     const Eigen::Isometry3d& T_curr_prev, const StereoFrame& prev,
                                     const StereoFrame& curr) const {
  const double dt_s = toSeconds(curr.stamp_ns - prev.stamp_ns);
  return velocity_
             ? estimateCameraMotion(matches, context_.camera, T_curr_prev, dt_s, parameters_.motion)
             : estimateMotion(matches, context_.camera, T_curr_prev, parameters_.motion);
}

/// Where the prediction knows an axis better than what is seen, the two are combined by their
/// covariances (Kalman's update); elsewhere it would only disturb.
void MotionMeter::supportWeakAxes(double dt_s, MotionMeasurement* measurement) const {
  if (!parameters_.motion.predict_weak_axes || !measurement->motion.ok()) return;
  Eigen::Isometry3d T_prev_curr = Eigen::Isometry3d::Identity();
  Matrix6d prediction = Matrix6d::Zero();
  if (velocity_) {
    T_prev_curr = motionAtVelocity(velocity_->value, dt_s);
    prediction = dt_s * dt_s * velocity_->covariance +
                 predictionCovariance(velocity_->value, true, dt_s, dt_s);
  } else {
    const TrackingParameters& tracking = parameters_.tracking;
    prediction.diagonal().head<3>().setConstant(std::pow(tracking.max_speed_m_s * dt_s, 2));
    prediction.diagonal().tail<3>().setConstant(
        std::pow(tracking.max_turn_rate_deg_s * M_PI / 180.0 * dt_s, 2));
  }
  measurement->weak = supportByPrediction(T_prev_curr, prediction, &measurement->motion);
}

TrackingReason MotionMeter::reasonOf(const MotionEstimate& motion, double dt_s) const {
  if (!motion.ok()) return trackingReason(motion.status);
  const Vector6d velocity = velocityOfMotion(motion.T_curr_prev.inverse(), dt_s);
  const bool too_fast =
      velocity.head<3>().norm() > parameters_.tracking.max_speed_m_s ||
      velocity.tail<3>().norm() * 180.0 / M_PI > parameters_.tracking.max_turn_rate_deg_s;
  return too_fast ? TrackingReason::kTooFast : TrackingReason::kNone;
}

MotionPrediction MotionMeter::predict(double dt_s) const {
  if (!velocity_) {
    return {Eigen::Isometry3d::Identity(), parameters_.matching.search_radius_without_velocity_px};
  }
  const double widening = std::clamp(dt_s / velocity_->measured_over_s, 1.0, kMaxWidening);
  return {motionAtVelocity(velocity_->value, dt_s).inverse(),
          widening * parameters_.matching.search_radius_px};
}

}  // namespace point_line_odometry
