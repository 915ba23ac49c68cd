#include "map/local_map.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "geometry/triangulation.h"
#include "map/bundle_list.h"
#include "map/landmark_ids.h"
#include "map/landmark_update.h"
#include "map/new_landmarks.h"
#include "motion/observations.h"

namespace point_line_odometry {
namespace {

// Relative-pose factors of the window: the tracked motions between keyframes, with this factor on
// their standard deviations. They come from the same observations, which must not count twice; but
// they contain those of all frames between the keyframes, and constrain motions that the few
// observations of the keyframes leave open.
constexpr double kTrackedSigmas = 6.0;

// A landmark in view is culled when it was missed more often in a row than this: kMinMissed + seen
// / 2, at most kMaxMissed.
constexpr int kMinMissed = 2;
constexpr int kMaxMissed = 20;

// Weight of the last frame in the exponential mean of the share of landmarks found.
constexpr double kShareOfLast = 0.2;

// Share of a bucket that unmatched points may fill even in slow motion.
constexpr double kLeastShareOfUnmatched = 0.25;

/// The covariance of a translation and rotation in axes rotated by R.
Matrix6d rotateCovariance(const Eigen::Matrix3d& R, const Matrix6d& covariance) {
  Matrix6d blocks = Matrix6d::Zero();
  blocks.topLeftCorner<3, 3>() = blocks.bottomRightCorner<3, 3>() = R;
  return blocks * covariance * blocks.transpose();
}

/// Where the left image has a point, whose observation is as of the stamp.
Eigen::Vector2f detectedPixel(const PointObservation& point, const FrameContext& context) {
  if (context.shutter.isGlobal()) return point.left_px.cast<float>();
  constexpr double kLeastDisparityPx = 0.01;  // noise may leave less of a far point's
  const StereoCamera& camera = context.camera;
  const double disparity_px = std::max(point.left_px.x() - point.right_px.x(), kLeastDisparityPx);
  const Eigen::Vector3d p_camera = backProject(camera, point.left_px, disparity_px);
  const Eigen::Vector2d pixel = camera.projectLeft(context.shutter.whenExposed(camera, p_camera));
  const Eigen::Vector2d last(camera.width - 1, camera.height - 1);
  return pixel.cwiseMax(0.0).cwiseMin(last).cast<float>();
}

/// Removes landmarks whose position is invalid.
template <typename Landmark>
void cull(const std::vector<std::uint64_t>& ids, std::vector<Landmark>* landmarks) {
  const auto culled = [&](const Landmark& landmark) {
    return std::find(ids.begin(), ids.end(), landmark.id) != ids.end();
  };
  landmarks->erase(std::remove_if(landmarks->begin(), landmarks->end(), culled), landmarks->end());
}

/// Counts landmarks in view as missed; updateLandmarks() resets the count of those observed.
template <typename Landmark>
void countMisses(const std::vector<bool>& in_view, std::vector<Landmark>* landmarks) {
  for (std::size_t i = 0; i < landmarks->size(); ++i)
    (*landmarks)[i].statistics.missed += in_view[i] ? 1 : 0;
}

/// Corrections of keyframes by a bundle adjustment: their ids, and the transform T with p_map = T *
/// p_map_before.
using WindowMoves = std::vector<std::pair<std::uint64_t, Eigen::Isometry3d>>;

void moveBy(const Eigen::Isometry3d& move, PointEstimate* estimate) {
  estimate->value = move * estimate->value;
}

void moveBy(const Eigen::Isometry3d& move, LineEstimate* estimate) {
  const Eigen::Vector3d start = estimate->value.head<3>();
  const Eigen::Vector3d end = estimate->value.tail<3>();
  estimate->value << move * start, move * end;
}

/// Landmarks are corrected with the last keyframe that observed them, so that a bundle adjustment
/// does not appear as a motion. The adjusted positions are weighted by the share of the landmark's
/// observations that were adjusted: those of the frames between keyframes are in the current
/// estimate only.
template <typename Solved, typename Landmark>
void applyPositions(const WindowMoves& moves, const std::vector<Solved>& solved,
                    std::vector<Landmark>* landmarks) {
  for (Landmark& landmark : *landmarks) {
    for (const auto& [id, move] : moves) {
      if (id == landmark.statistics.last_keyframe) moveBy(move, &landmark.estimate);
    }
  }
  const LandmarkIds ids(*landmarks);
  for (const Solved& adjusted : solved) {
    const int i = ids.indexOf(adjusted.id);
    if (i < 0) continue;
    Landmark& landmark = (*landmarks)[i];
    const double share =
        static_cast<double>(adjusted.observations.size()) / landmark.statistics.seen;
    landmark.estimate.value +=
        std::min(share, 1.0) * (adjusted.estimate.value - landmark.estimate.value).eval();
  }
}

}  // namespace

int countInliers(const std::vector<bool>& inliers, std::size_t num_matches) {
  const auto end = inliers.begin() + static_cast<std::ptrdiff_t>(num_matches);
  return static_cast<int>(std::count(inliers.begin(), end, true));
}

int countInView(const LandmarkMatches& landmark_matches) {
  const auto count = [](const std::vector<bool>& landmarks) {
    return static_cast<int>(std::count(landmarks.begin(), landmarks.end(), true));
  };
  return count(landmark_matches.point_in_view) + count(landmark_matches.line_in_view);
}

double shareFound(const LandmarkMatches& landmark_matches, const MotionEstimate& motion) {
  const int all = countInView(landmark_matches);
  const int found = countInliers(motion.point_inliers, landmark_matches.points.size()) +
                    countInliers(motion.line_inliers, landmark_matches.lines.size());
  return static_cast<double>(found) / std::max(all, 1);
}

LandmarkMatches LocalMap::find(const StereoFrame& frame, const FrameContext& context,
                               const Eigen::Isometry3d& T_map_camera, ThreadPool* threads) const {
  LandmarkMatches landmark_matches;
  const Eigen::Isometry3d T_camera_map = T_map_camera.inverse();
  findPoints(points_, T_camera_map, frame, context, threads, &landmark_matches);
  findLines(lines_, T_camera_map, frame, context, threads, &landmark_matches);
  return landmark_matches;
}

LandmarkMatches LocalMap::align(const FrameContext& context, const Eigen::Isometry3d& T_map_camera,
                                ThreadPool* threads) const {
  LandmarkMatches landmark_matches;
  const Eigen::Isometry3d T_camera_map = T_map_camera.inverse();
  alignPoints(points_, T_camera_map, context, threads, &landmark_matches);
  alignLines(lines_, T_camera_map, context, threads, &landmark_matches);
  return landmark_matches;
}

Correspondences LocalMap::correspondences(const LandmarkMatches& landmark_matches,
                                          const FrameContext& context) const {
  const Eigen::Isometry3d T_previous_map = T_map_previous_.inverse();
  const Eigen::Matrix3d& R = T_previous_map.linear();
  Correspondences correspondences;
  correspondences.disparity_error_px = context.correction.disparity_error_px;
  correspondences.shutter = context.shutter;
  correspondences.points.reserve(landmark_matches.points.size());
  for (const LandmarkMatches::Point& point : landmark_matches.points) {
    const PointEstimate& estimate = points_[point.landmark].estimate;
    PointCorrespondence match = correspondence(estimate, point.observation);
    match.p_prev = T_previous_map * match.p_prev;
    const PointEstimate::SqrtCovariance sqrt_covariance = R * estimate.sqrt_covariance;
    match.covariance = sqrt_covariance * sqrt_covariance.transpose();
    correspondences.points.push_back(match);
  }
  correspondences.lines.reserve(landmark_matches.lines.size());
  for (const LandmarkMatches::Line& line : landmark_matches.lines) {
    const LineEstimate& estimate = lines_[line.landmark].estimate;
    LineCorrespondence match = correspondence(estimate, line.observation);
    match.start_prev = T_previous_map * match.start_prev;
    match.end_prev = T_previous_map * match.end_prev;
    LineEstimate::SqrtCovariance sqrt_covariance;
    sqrt_covariance << R * estimate.sqrt_covariance.topRows<3>(),
        R * estimate.sqrt_covariance.bottomRows<3>();
    match.covariance = sqrt_covariance * sqrt_covariance.transpose();
    correspondences.lines.push_back(match);
  }
  return correspondences;
}

void LocalMap::add(const StereoFrame& frame, const FrameContext& context,
                   const LandmarkMatches& landmark_matches, const MotionEstimate& motion,
                   const LandmarkCandidates& candidates, ThreadPool* threads) {
  movePrevious(motion.T_curr_prev.inverse());
  previous_.covariance = rotateCovariance(motion.T_curr_prev.linear(), motion.covariance);
  const double share_found = point_line_odometry::shareFound(landmark_matches, motion);
  share_found_ += (share_found_ > 0.0 ? kShareOfLast : 1.0) * (share_found - share_found_);
  countMisses(landmark_matches.point_in_view, &points_);
  countMisses(landmark_matches.line_in_view, &lines_);
  updateLandmarks(context.camera, landmark_matches, motion, threads, &previous_);
  const double num_old = static_cast<double>(previous_.size());
  const bool keyframe = needsKeyframe(context.parameters.window);
  addPoints(frame, context, candidates, threads);
  addLines(frame, context, candidates.lines, landmark_matches);
  share_of_new_ = 1.0 - num_old / std::max<double>(static_cast<double>(previous_.size()), 1.0);
  if (keyframe && previous_.size() > 0) addKeyframe(context.parameters);
  cullLandmarks();
}

void LocalMap::movePrevious(const Eigen::Isometry3d& T_previous_camera) {
  T_map_previous_ = T_map_previous_ * T_previous_camera;
  T_map_previous_.linear() =
      Eigen::Quaterniond(T_map_previous_.linear()).normalized().toRotationMatrix();
  previous_ = Observations();
  previous_.T_map_camera = T_map_previous_;
}

void LocalMap::observe(const FrameContext& context, const LandmarkMatches& landmark_matches,
                       const MotionEstimate& motion, ThreadPool* threads) {
  Observations frame;
  frame.T_map_camera = T_map_previous_ * motion.T_curr_prev.inverse();
  frame.covariance = rotateCovariance(motion.T_curr_prev.linear(), motion.covariance);
  updateLandmarks(context.camera, landmark_matches, motion, threads, &frame);
}

/// By the inlier matches of a frame, which are added to it.
void LocalMap::updateLandmarks(const StereoCamera& camera, const LandmarkMatches& landmark_matches,
                               const MotionEstimate& motion, ThreadPool* threads,
                               Observations* frame) {
  const Eigen::Isometry3d T_camera_map = frame->T_map_camera.inverse();
  std::vector<std::uint64_t> wrong;
  const auto update = [&](const auto& matches, const std::vector<bool>& inliers, auto* landmarks,
                          auto* entries) {
    std::vector<std::uint8_t> valid(matches.size());  // not bool: those of a byte share it
    runParts(threads, matches.size(), [&](int, std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        if (!inliers[i]) continue;
        valid[i] = ekfUpdate(camera, T_camera_map, frame->covariance, matches[i].observation,
                             &(*landmarks)[matches[i].landmark].estimate);
      }
    });
    for (std::size_t i = 0; i < matches.size(); ++i) {
      if (!inliers[i]) continue;
      auto& landmark = (*landmarks)[matches[i].landmark];
      ++landmark.statistics.seen;
      landmark.statistics.missed = 0;
      if (valid[i] != 0) {
        entries->push_back({landmark.id, matches[i].observation});
      } else {
        wrong.push_back(landmark.id);
      }
    }
  };
  update(landmark_matches.points, motion.point_inliers, &points_, &frame->points);
  update(landmark_matches.lines, motion.line_inliers, &lines_, &frame->lines);
  cull(wrong, &points_);
  cull(wrong, &lines_);
}

void LocalMap::cullLandmarks() {
  const std::uint64_t oldest = keyframes_.empty() ? 0 : keyframes_.front().id;
  const auto lost = [&](const auto& landmark) {
    const TrackStatistics& statistics = landmark.statistics;
    return statistics.missed > std::min(kMinMissed + statistics.seen / 2, kMaxMissed) ||
           statistics.last_keyframe < oldest;
  };
  points_.erase(std::remove_if(points_.begin(), points_.end(), lost), points_.end());
  lines_.erase(std::remove_if(lines_.begin(), lines_.end(), lost), lines_.end());
}

/// Fills buckets with room: inliers first, then unmatched points, each the strongest first. The
/// larger the share of new landmarks, the more the view changes between frames, the fewer points
/// are matched, and the more unmatched ones are added.
void LocalMap::addPoints(const StereoFrame& frame, const FrameContext& context,
                         const LandmarkCandidates& candidates, ThreadPool* threads) {
  PointBuckets buckets(context.camera, context.parameters.points.cell_size_px);
  for (const Entry<PointObservation>& seen : previous_.points)
    buckets.occupy(detectedPixel(seen.observation, context));
  const auto feature = [&](int i) -> const Keypoint& {
    return frame.features.points_left[frame.points[i].left];
  };
  std::vector<int> chosen;
  const auto choose = [&](std::vector<int> strongest_first, int wanted) {
    std::stable_sort(strongest_first.begin(), strongest_first.end(),
                     [&](int a, int b) { return feature(a).response > feature(b).response; });
    for (const int i : strongest_first) {
      const Eigen::Vector2f& pixel = feature(i).pixel;
      if (patchFits(pixel, context.camera) && buckets.take(pixel, wanted)) chosen.push_back(i);
    }
  };
  const int per_cell = context.parameters.window.points_per_cell;
  choose(candidates.points, per_cell);
  const double share = std::max(kLeastShareOfUnmatched, share_of_new_);
  choose(candidates.unmatched_points, static_cast<int>(std::lround(share * per_cell)));
  std::vector<MapPoint> points(chosen.size());
  runParts(threads, chosen.size(), [&](int, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
      points[i] = makePoint(frame, frame.points[chosen[i]], context.camera, T_map_previous_);
  });
  for (std::size_t i = 0; i < chosen.size(); ++i)
    addPoint(frame, context, frame.points[chosen[i]], points[i]);
}

void LocalMap::addPoint(const StereoFrame& frame, const FrameContext& context,
                        const StereoPoint& stereo, MapPoint point) {
  if (!point.estimate.value.allFinite() || !point.estimate.sqrt_covariance.allFinite()) return;
  point.id = next_landmark_++;
  point.statistics.last_keyframe = next_keyframe_;
  const Eigen::Vector2f& left_px = frame.features.points_left[stereo.left].pixel;
  previous_.points.push_back(
      {point.id, pointObservation(left_px, stereo.right_px, stereo.sigma_px, context)});
  points_.push_back(point);
}

/// Adds all candidates that are not in the map.
void LocalMap::addLines(const StereoFrame& frame, const FrameContext& context,
                        const std::vector<int>& candidates,
                        const LandmarkMatches& landmark_matches) {
  std::vector<bool> known(frame.lines.size(), false);
  for (const LandmarkMatches::Line& line : landmark_matches.lines) known[line.stereo_line] = true;
  for (const int i : candidates) {
    const StereoLine& stereo = frame.lines[i];
    if (known[i] || !stereo.triangulated) continue;
    MapLine line = makeLine(frame, stereo, T_map_previous_);
    if (!line.estimate.value.allFinite() || !line.estimate.sqrt_covariance.allFinite()) continue;
    line.id = next_landmark_++;
    line.statistics.last_keyframe = next_keyframe_;
    previous_.lines.push_back({line.id, lineObservation(frame.features, stereo, context)});
    lines_.push_back(line);
  }
}

bool LocalMap::needsKeyframe(const WindowParameters& window) const {
  if (keyframes_.empty()) return true;
  const Observations& keyframe = keyframes_.back();
  std::vector<std::uint64_t> then;
  for (const auto& entry : keyframe.points) then.push_back(entry.landmark);
  for (const auto& entry : keyframe.lines) then.push_back(entry.landmark);
  std::sort(then.begin(), then.end());
  const auto seen_then = [&](const auto& entry) {
    return std::binary_search(then.begin(), then.end(), entry.landmark);
  };
  const auto common = std::count_if(previous_.points.begin(), previous_.points.end(), seen_then) +
                      std::count_if(previous_.lines.begin(), previous_.lines.end(), seen_then);
  return static_cast<double>(common) < window.keyframe_overlap * static_cast<double>(then.size());
}

void LocalMap::addKeyframe(const Parameters& parameters) {
  previous_.id = next_keyframe_++;
  const auto mark = [&](const auto& entries, auto* landmarks) {
    const LandmarkIds ids(*landmarks);
    for (const auto& entry : entries) {
      const int i = ids.indexOf(entry.landmark);
      if (i >= 0) (*landmarks)[i].statistics.last_keyframe = previous_.id;
    }
  };
  mark(previous_.points, &points_);
  mark(previous_.lines, &lines_);
  if (!keyframes_.empty()) {
    previous_.T_last_keyframe_this = keyframes_.back().T_map_camera.inverse() * T_map_previous_;
  }
  keyframes_.push_back(previous_);
  const auto most = static_cast<std::size_t>(parameters.window.size + parameters.local_map.size);
  while (keyframes_.size() > most) keyframes_.pop_front();
  keyframe_is_new_ = true;
}

std::optional<BundleProblem> LocalMap::takeProblem(const WindowParameters& window) {
  if (!keyframe_is_new_) return std::nullopt;
  keyframe_is_new_ = false;
  // The window's keyframes are estimated, as many before them are fixed.
  const std::size_t num_free =
      std::min(keyframes_.size() - 1, static_cast<std::size_t>(window.size));
  const std::size_t num_fixed = std::min(keyframes_.size() - num_free, num_free);
  if (num_free < 2) return std::nullopt;
  const std::size_t first = keyframes_.size() - num_free - num_fixed;

  BundleProblem problem;
  BundleList points(points_, &problem.points);
  BundleList lines(lines_, &problem.lines);
  for (std::size_t k = first; k < keyframes_.size(); ++k) {
    const bool fixed = k < first + num_fixed;
    problem.frames.push_back({keyframes_[k].id, keyframes_[k].T_map_camera, fixed});
    if (fixed) continue;
    points.add(keyframes_[k].points);
    lines.add(keyframes_[k].lines);
  }
  for (std::size_t k = first; k < keyframes_.size(); ++k) {
    points.observe(keyframes_[k].points, static_cast<int>(k - first));
    lines.observe(keyframes_[k].lines, static_cast<int>(k - first));
  }
  for (std::size_t k = first + num_fixed; k < keyframes_.size(); ++k) {
    const int to = static_cast<int>(k - first);
    const Observations& keyframe = keyframes_[k];
    const Matrix6d covariance =
        keyframe.covariance + rotateCovariance(keyframe.T_last_keyframe_this.linear().transpose(),
                                               keyframes_[k - 1].covariance);
    problem.motions.push_back(
        {to - 1, to, keyframe.T_last_keyframe_this, kTrackedSigmas * kTrackedSigmas * covariance});
  }
  points.dropSingle();
  lines.dropSingle();
  if (!problem.hasLandmarks()) return std::nullopt;
  return problem;
}

void LocalMap::applyResult(const BundleProblem& solved) {
  WindowMoves moves;
  for (const BundleProblem::Frame& frame : solved.frames) {
    for (Observations& keyframe : keyframes_) {
      if (keyframe.id != frame.id) continue;
      const Eigen::Isometry3d move = frame.T_map_camera * keyframe.T_map_camera.inverse();
      if (&frame == &solved.frames.back()) T_map_previous_ = move * T_map_previous_;
      moves.emplace_back(frame.id, move);
      keyframe.T_map_camera = frame.T_map_camera;
    }
  }
  const auto cull_wrong = [](const auto& list, auto* landmarks) {
    std::vector<std::uint64_t> wrong;
    for (const auto& landmark : list) {
      if (landmark.culled) wrong.push_back(landmark.id);
    }
    cull(wrong, landmarks);
  };
  cull_wrong(solved.points, &points_);
  cull_wrong(solved.lines, &lines_);
  applyPositions(moves, solved.points, &points_);
  applyPositions(moves, solved.lines, &lines_);
}

}  // namespace point_line_odometry
