#include "map/local_map.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "map/new_landmarks.h"

namespace point_line_odometry {
namespace {

constexpr auto kBoth = ResidualImages::kBoth;

// The window keeps to the motions that tracking found, within so many of their standard deviations.
// They come from the same sights, which must not count twice; but tracking has seen the landmarks
// in all the frames between, and knows where the few sights of the keyframes alone leave a motion
// open.
constexpr double kTrackedSigmas = 6.0;

// A landmark that should be in view is forgotten when it was missed so many times in a row: sooner
// if it was hardly ever seen.
constexpr int kMinMissed = 2;
constexpr int kMaxMissed = 20;

// How much the last frame counts in the mean share of landmarks found.
constexpr double kShareOfLast = 0.2;

// Of the points wanted in a cell, the share that unmatched ones may fill even in slow motion.
constexpr double kLeastShareOfUnmatched = 0.25;

/// The covariance of a translation and rotation in axes turned by a rotation.
Matrix6d inOtherAxes(const Eigen::Matrix3d& R, const Matrix6d& covariance) {
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = R;
  return turn * covariance * turn.transpose();
}

/// Index of a landmark, or -1 if it is forgotten.
template <typename Landmark>
int indexOf(const std::vector<Landmark>& landmarks, std::uint64_t id) {
  const auto it = std::lower_bound(landmarks.begin(), landmarks.end(), id,
                                   [](const Landmark& a, std::uint64_t b) { return a.id < b; });
  return it != landmarks.end() && it->id == id ? static_cast<int>(it - landmarks.begin()) : -1;
}

/// The place becomes better known by a sight from a pose. Returns false if it is wrong: behind the
/// camera that sees it, where the update is far from linear, as for an end of a line that is hardly
/// known along its ray.
template <typename Residual, typename Place, typename Sight>
bool improve(const StereoCamera& camera, const Eigen::Isometry3d& T_camera_map, const Sight& sight,
             Place* place) {
  const Residual residual(correspondence(*place, sight), camera, T_camera_map);
  if (!residual.valid) return false;
  using Noise = Eigen::Matrix<double, Residual::kRows, Residual::kRows>;
  place->template update<Residual::kRows>(residual.value, residual.byLandmark(),
                                          sight.sigma_px * sight.sigma_px * Noise::Identity());
  return Residual(correspondence(*place, sight), camera, T_camera_map).valid;
}

/// Removes landmarks whose place is wrong.
template <typename Landmark>
void cull(const std::vector<std::uint64_t>& ids, std::vector<Landmark>* landmarks) {
  const auto culled = [&](const Landmark& landmark) {
    return std::find(ids.begin(), ids.end(), landmark.id) != ids.end();
  };
  landmarks->erase(std::remove_if(landmarks->begin(), landmarks->end(), culled), landmarks->end());
}

/// Counts how a landmark was looked for.
template <typename Landmark>
void countMisses(const std::vector<bool>& in_view, std::vector<Landmark>* landmarks) {
  for (std::size_t i = 0; i < landmarks->size(); ++i)
    (*landmarks)[i].sightings.missed += in_view[i] ? 1 : 0;
}

/// What a window has done to its keyframes: their ids, and p_map after it <- p_map before.
using WindowMoves = std::vector<std::pair<std::uint64_t, Eigen::Isometry3d>>;

void moveBy(const Eigen::Isometry3d& move, PointBelief* place) {
  place->value = move * place->value;
}

void moveBy(const Eigen::Isometry3d& move, LineBelief* place) {
  const Eigen::Vector3d start = place->value.head<3>();
  const Eigen::Vector3d end = place->value.tail<3>();
  place->value << move * start, move * end;
}

/// Landmarks go with the last keyframe that saw them: seen from there, they stay where they are,
/// and a window does not look like a motion. The solution counts for the sights that it knows: the
/// frames between keyframes have made the place better known, too.
template <typename Solved, typename Landmark>
void adoptPlaces(const WindowMoves& moves, const std::vector<Solved>& solved,
                 std::vector<Landmark>* landmarks) {
  for (Landmark& landmark : *landmarks) {
    for (const auto& [id, move] : moves) {
      if (id == landmark.sightings.last_keyframe) moveBy(move, &landmark.place);
    }
  }
  for (const Solved& solution : solved) {
    const int i = indexOf(*landmarks, solution.id);
    if (i < 0) continue;
    Landmark& landmark = (*landmarks)[i];
    const double known = static_cast<double>(solution.sights.size()) / landmark.sightings.seen;
    landmark.place.value +=
        std::min(known, 1.0) * (solution.place.value - landmark.place.value).eval();
  }
}

}  // namespace

int countInliers(const std::vector<bool>& inliers, std::size_t num_matches) {
  const auto end = inliers.begin() + static_cast<std::ptrdiff_t>(num_matches);
  return static_cast<int>(std::count(inliers.begin(), end, true));
}

double shareFound(const MapSights& sights, const MotionEstimate& motion) {
  const auto in_view = [](const std::vector<bool>& landmarks) {
    return std::count(landmarks.begin(), landmarks.end(), true);
  };
  const auto all = in_view(sights.point_in_view) + in_view(sights.line_in_view);
  const int found = countInliers(motion.point_inliers, sights.points.size()) +
                    countInliers(motion.line_inliers, sights.lines.size());
  return static_cast<double>(found) / std::max(static_cast<double>(all), 1.0);
}

MapSights LocalMap::find(const StereoFrame& frame, const FrameContext& context,
                         const Eigen::Isometry3d& T_map_camera, ThreadPool* threads) const {
  MapSights sights;
  const Eigen::Isometry3d T_camera_map = T_map_camera.inverse();
  findPoints(points_, T_camera_map, frame, context, threads, &sights);
  findLines(lines_, T_camera_map, frame, context, &sights);
  return sights;
}

Correspondences LocalMap::correspondences(const MapSights& sights) const {
  const Eigen::Isometry3d T_reference_map = T_map_reference_.inverse();
  const Eigen::Matrix3d& R = T_reference_map.linear();
  Correspondences correspondences;
  correspondences.points.reserve(sights.points.size());
  for (const MapSights::Point& point : sights.points) {
    const PointBelief& place = points_[point.landmark].place;
    PointCorrespondence match = correspondence(place, point.sight);
    match.p_prev = T_reference_map * match.p_prev;
    const PointBelief::Spread spread = R * place.spread;
    match.covariance = spread * spread.transpose();
    correspondences.points.push_back(match);
  }
  correspondences.lines.reserve(sights.lines.size());
  for (const MapSights::Line& line : sights.lines) {
    const LineBelief& place = lines_[line.landmark].place;
    LineCorrespondence match = correspondence(place, line.sight);
    match.start_prev = T_reference_map * match.start_prev;
    match.end_prev = T_reference_map * match.end_prev;
    LineBelief::Spread spread;
    spread << R * place.spread.topRows<3>(), R * place.spread.bottomRows<3>();
    match.covariance = spread * spread.transpose();
    correspondences.lines.push_back(match);
  }
  return correspondences;
}

void LocalMap::add(const StereoFrame& frame, const FrameContext& context, const MapSights& sights,
                   const MotionEstimate& motion, const LandmarkCandidates& candidates) {
  moveReference(motion.T_curr_prev.inverse());
  reference_.covariance = inOtherAxes(motion.T_curr_prev.linear(), motion.covariance);
  const double share_found = point_line_odometry::shareFound(sights, motion);
  share_found_ += (share_found_ > 0.0 ? kShareOfLast : 1.0) * (share_found - share_found_);
  countMisses(sights.point_in_view, &points_);
  countMisses(sights.line_in_view, &lines_);
  learn(context.camera, sights, motion);
  const double num_old = static_cast<double>(reference_.size());
  const bool keyframe = needsKeyframe();
  addPoints(frame, context, candidates);
  addLines(frame, context, candidates.lines, sights);
  share_of_new_ = 1.0 - num_old / std::max<double>(static_cast<double>(reference_.size()), 1.0);
  if (keyframe && reference_.size() > 0) addKeyframe();
  forget();
}

void LocalMap::moveReference(const Eigen::Isometry3d& T_reference_camera) {
  T_map_reference_ = T_map_reference_ * T_reference_camera;
  T_map_reference_.linear() =
      Eigen::Quaterniond(T_map_reference_.linear()).normalized().toRotationMatrix();
  reference_ = Observations();
  reference_.T_map_camera = T_map_reference_;
}

void LocalMap::learn(const StereoCamera& camera, const MapSights& sights,
                     const MotionEstimate& motion) {
  const Eigen::Isometry3d T_camera_map = T_map_reference_.inverse();
  std::vector<std::uint64_t> wrong;
  const auto see = [&](const auto& sight, bool improved, auto* landmark, auto* entries) {
    ++landmark->sightings.seen;
    landmark->sightings.missed = 0;
    if (improved) {
      entries->push_back({landmark->id, sight});
    } else {
      wrong.push_back(landmark->id);
    }
  };
  for (std::size_t i = 0; i < sights.points.size(); ++i) {
    if (!motion.point_inliers[i]) continue;
    const PointSight& sight = sights.points[i].sight;
    MapPoint& point = points_[sights.points[i].landmark];
    see(sight, improve<PointResidual<kBoth>>(camera, T_camera_map, sight, &point.place), &point,
        &reference_.points);
  }
  for (std::size_t i = 0; i < sights.lines.size(); ++i) {
    if (!motion.line_inliers[i]) continue;
    const LineSight& sight = sights.lines[i].sight;
    MapLine& line = lines_[sights.lines[i].landmark];
    see(sight, improve<LineResidual<kBoth>>(camera, T_camera_map, sight, &line.place), &line,
        &reference_.lines);
  }
  cull(wrong, &points_);
  cull(wrong, &lines_);
}

void LocalMap::forget() {
  const std::uint64_t oldest = keyframes_.empty() ? 0 : keyframes_.front().id;
  const auto forgotten = [&](const auto& landmark) {
    const Sightings& sightings = landmark.sightings;
    return sightings.missed > std::min(kMinMissed + sightings.seen / 2, kMaxMissed) ||
           sightings.last_keyframe < oldest;
  };
  points_.erase(std::remove_if(points_.begin(), points_.end(), forgotten), points_.end());
  lines_.erase(std::remove_if(lines_.begin(), lines_.end(), forgotten), lines_.end());
}

/// Where cells want more: inliers first, and of either kind the strongest first. The more of what
/// is seen is new, the fewer points look as they did a frame ago, and the more unmatched ones
/// count.
void LocalMap::addPoints(const StereoFrame& frame, const FrameContext& context,
                         const LandmarkCandidates& candidates) {
  PointQuota quota(context.camera, context.parameters.points.cell_size_px);
  for (const Entry<PointSight>& seen : reference_.points)
    quota.occupy(seen.sight.left_px.cast<float>());
  const auto feature = [&](int i) -> const PointFeature& {
    return frame.features.points_left[frame.points[i].left];
  };
  const auto add = [&](std::vector<int> strongest_first, int wanted) {
    std::stable_sort(strongest_first.begin(), strongest_first.end(),
                     [&](int a, int b) { return feature(a).response > feature(b).response; });
    for (const int i : strongest_first) {
      const Eigen::Vector2f& pixel = feature(i).pixel;
      if (patchFits(pixel, context.camera) && quota.take(pixel, wanted))
        addPoint(frame, context, frame.points[i]);
    }
  };
  add(candidates.points, window_.points_per_cell);
  const double share = std::max(kLeastShareOfUnmatched, share_of_new_);
  add(candidates.unmatched_points, static_cast<int>(std::lround(share * window_.points_per_cell)));
}

void LocalMap::addPoint(const StereoFrame& frame, const FrameContext& context,
                        const StereoPoint& stereo) {
  MapPoint point = makePoint(frame, stereo, T_map_reference_);
  if (!point.place.value.allFinite() || !point.place.spread.allFinite()) return;
  point.id = next_landmark_++;
  point.sightings.last_keyframe = next_keyframe_;
  PointSight sight;
  sight.left_px = frame.features.points_left[stereo.left].pixel.cast<double>();
  sight.right_px = context.correction.apply(stereo.right_px.cast<double>());
  sight.sigma_px = stereo.sigma_px;
  reference_.points.push_back({point.id, sight});
  points_.push_back(point);
}

/// All that are not in the map.
void LocalMap::addLines(const StereoFrame& frame, const FrameContext& context,
                        const std::vector<int>& candidates, const MapSights& sights) {
  std::vector<bool> known(frame.lines.size(), false);
  for (const MapSights::Line& line : sights.lines) known[line.stereo_line] = true;
  for (const int i : candidates) {
    const StereoLine& stereo = frame.lines[i];
    if (known[i] || !stereo.triangulated) continue;
    MapLine line = makeLine(frame, stereo, T_map_reference_);
    if (!line.place.value.allFinite() || !line.place.spread.allFinite()) continue;
    line.id = next_landmark_++;
    line.sightings.last_keyframe = next_keyframe_;
    reference_.lines.push_back({line.id, lineSight(frame.features, stereo, context)});
    lines_.push_back(line);
  }
}

bool LocalMap::needsKeyframe() const {
  if (keyframes_.empty()) return true;
  const Observations& keyframe = keyframes_.back();
  std::vector<std::uint64_t> then;
  for (const auto& entry : keyframe.points) then.push_back(entry.landmark);
  for (const auto& entry : keyframe.lines) then.push_back(entry.landmark);
  std::sort(then.begin(), then.end());
  const auto seen_then = [&](const auto& entry) {
    return std::binary_search(then.begin(), then.end(), entry.landmark);
  };
  const auto common = std::count_if(reference_.points.begin(), reference_.points.end(), seen_then) +
                      std::count_if(reference_.lines.begin(), reference_.lines.end(), seen_then);
  return static_cast<double>(common) < window_.keyframe_overlap * static_cast<double>(then.size());
}

void LocalMap::addKeyframe() {
  reference_.id = next_keyframe_++;
  const auto mark = [&](const auto& entries, auto* landmarks) {
    for (const auto& entry : entries) {
      const int i = indexOf(*landmarks, entry.landmark);
      if (i >= 0) (*landmarks)[i].sightings.last_keyframe = reference_.id;
    }
  };
  mark(reference_.points, &points_);
  mark(reference_.lines, &lines_);
  if (!keyframes_.empty()) {
    reference_.T_previous_this = keyframes_.back().T_map_camera.inverse() * T_map_reference_;
  }
  keyframes_.push_back(reference_);
  const auto most = static_cast<std::size_t>(window_.size + local_map_.size);
  while (keyframes_.size() > most) keyframes_.pop_front();
  keyframe_is_new_ = true;
}

std::optional<BundleProblem> LocalMap::takeProblem() {
  if (!keyframe_is_new_) return std::nullopt;
  keyframe_is_new_ = false;
  // The window's keyframes are free, as many before them hold it.
  const std::size_t free = std::min(keyframes_.size() - 1, static_cast<std::size_t>(window_.size));
  const std::size_t held = std::min(keyframes_.size() - free, free);
  if (free < 2) return std::nullopt;
  const std::size_t first = keyframes_.size() - free - held;

  BundleProblem problem;
  std::vector<int> point_place(points_.size(), -1);  // in the problem's list
  std::vector<int> line_place(lines_.size(), -1);
  const auto enlist = [](const auto& entries, const auto& landmarks, auto* places, auto* list) {
    for (const auto& entry : entries) {
      const int i = indexOf(landmarks, entry.landmark);
      if (i < 0 || (*places)[i] >= 0) continue;
      (*places)[i] = static_cast<int>(list->size());
      list->emplace_back();
      list->back().id = landmarks[i].id;
      list->back().place = landmarks[i].place;
    }
  };
  for (std::size_t k = first; k < keyframes_.size(); ++k) {
    const bool fixed = k < first + held;
    problem.frames.push_back({keyframes_[k].id, keyframes_[k].T_map_camera, fixed});
    if (fixed) continue;
    enlist(keyframes_[k].points, points_, &point_place, &problem.points);
    enlist(keyframes_[k].lines, lines_, &line_place, &problem.lines);
  }
  const auto observe = [](const auto& entries, const auto& landmarks, const auto& places, int frame,
                          auto* list) {
    for (const auto& entry : entries) {
      const int i = indexOf(landmarks, entry.landmark);
      if (i >= 0 && places[i] >= 0) (*list)[places[i]].sights.push_back({frame, entry.sight});
    }
  };
  for (std::size_t k = first; k < keyframes_.size(); ++k) {
    const int frame = static_cast<int>(k - first);
    observe(keyframes_[k].points, points_, point_place, frame, &problem.points);
    observe(keyframes_[k].lines, lines_, line_place, frame, &problem.lines);
  }
  for (std::size_t k = first + held; k < keyframes_.size(); ++k) {
    const int to = static_cast<int>(k - first);
    const Observations& keyframe = keyframes_[k];
    const Matrix6d covariance =
        keyframe.covariance +
        inOtherAxes(keyframe.T_previous_this.linear().transpose(), keyframes_[k - 1].covariance);
    problem.motions.push_back(
        {to - 1, to, keyframe.T_previous_this, kTrackedSigmas * kTrackedSigmas * covariance});
  }
  const auto drop_single = [](auto* list) {
    const auto single = [](const auto& landmark) { return landmark.sights.size() < 2; };
    list->erase(std::remove_if(list->begin(), list->end(), single), list->end());
  };
  drop_single(&problem.points);
  drop_single(&problem.lines);
  if (!problem.hasLandmarks()) return std::nullopt;
  return problem;
}

void LocalMap::adopt(const BundleProblem& solved) {
  WindowMoves moves;
  for (const BundleProblem::Frame& frame : solved.frames) {
    for (Observations& keyframe : keyframes_) {
      if (keyframe.id != frame.id) continue;
      const Eigen::Isometry3d move = frame.T_map_camera * keyframe.T_map_camera.inverse();
      if (&frame == &solved.frames.back()) T_map_reference_ = move * T_map_reference_;
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
  adoptPlaces(moves, solved.points, &points_);
  adoptPlaces(moves, solved.lines, &lines_);
}

}  // namespace point_line_odometry
