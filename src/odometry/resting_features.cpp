#include "odometry/resting_features.h"

#include <algorithm>
#include <iterator>
#include <optional>
#include <utility>

#include "common/statistics.h"
#include "matching/point_grid.h"
#include "motion/motion_consensus.h"
#include "odometry/motion_confirmation.h"
#include "odometry/moving_scene.h"

namespace point_line_odometry {
namespace {

// [px of a point's level] A point that should move by more does not rest by chance.
constexpr double kMoves_px = 3.0;

/// What counts as moving [px of a point's level]: a scene's points by at least the one, and what
/// rests before it should move by at least the other.
struct Speed {
  double scene_px;
  double body_px;
};
constexpr Speed kFast = {2.0 * kRests_px, kMoves_px};
constexpr Speed kSlow = {kRests_px, kRests_px};

// Of the points that should move in a cell and around it, at most 2 % seem to rest where they are
// the scene's, and usually at least a fifth where something rests.
constexpr int kFewestPoints = 6;
constexpr double kShareResting = 0.15;

// Once a body was found before a scene, it is searched to its edges. In the dark fewer of its
// points are found again, as of the scene's: at least this share of theirs (a mean over frames).
// Where there are too few points to tell, as many cells around are looked at.
constexpr double kShareOfFound = 0.2;
constexpr double kWeightOfFrame = 0.1;
constexpr int kMostCells = 4;

// Where its body is in view and the scene moves slowly, a moving camera that is taken for
// stationary finds up to 0.70 of the features.
constexpr double kShareWithBody = 0.75;

// Two motions differ if they move a point that rests by so much of what one of them does: a third
// one may lie between rest and the scene's.
constexpr double kOtherMotion = 1.0 / 3.0;

// Resting points that count are this share of the inliers of a motion, and half of it once a part
// of the body was found. Of a scene the points that agree are this share of the inliers (traffic
// before a standing robot 0.09 at most, a scene more) and this number, in the dark in successive
// frames together.
constexpr double kShareOfInliers = 0.2;
constexpr double kShareOfMovingScene = 0.1;
constexpr int kMinScene = 20;

// A circle around a point in which so many inliers are expected, if they are anywhere in the image,
// is seldom without one. Where the camera is at rest, at most this share of the points that were
// not found is so isolated (in the dark 7 %), and where a body rests before an unseen scene more.
constexpr double kInliersAround = 5.0;
constexpr double kShareIsolated = 0.1;
constexpr double kFewestIsolated = 10.0;

// Half of what a camera sees of its own robot is nearer than this. A shore before the sea, or a
// street before trees in the wind, is not.
constexpr double kFarthestBody_m = 3.0;

/// [m]
std::vector<double> depthsOf(const std::vector<int>& points, const StereoFrame& frame) {
  std::vector<double> depths;
  depths.reserve(points.size());
  for (const int i : points) depths.push_back(frame.points[i].triangulated.p_camera.z());
  return depths;
}

/// Of points that rest, those that a scene's motion should move. What it does not move is part of
/// the scene, too, and there is nothing in the way where the motion that was found is the scene's.
std::vector<int> bodyBefore(const MovingScene& scene, const std::vector<int>& resting,
                            const StereoFrame& prev, const TrackingResult& tracked,
                            const Speed& speed, const FrameContext& context) {
  const Eigen::Isometry3d rest = Eigen::Isometry3d::Identity();
  const MotionEstimate& found = tracked.frame_to_frame;
  const Eigen::Isometry3d& held = found.ok() ? found.T_curr_prev : rest;
  std::vector<int> body;
  std::copy_if(resting.begin(), resting.end(), std::back_inserter(body), [&](int i) {
    const StereoPoint& point = prev.points[i];
    const double expected = shiftBetween(prev, point, scene.T_curr_prev, rest, context);
    return expected >= speed.body_px &&
           shiftBetween(prev, point, scene.T_curr_prev, held, context) >= kOtherMotion * expected;
  });
  return body;
}

/// Near points of a frame that were not found, far from all inliers in the image, if they are too
/// many for the scene of a camera at rest; else none.
std::vector<int> isolatedPoints(const std::vector<MatchedPoint>& inliers, const StereoFrame& prev,
                                const StereoCamera& camera) {
  std::vector<bool> found(prev.points.size(), false);
  for (const MatchedPoint& match : inliers) found[match.prev] = true;
  const double area_px = static_cast<double>(camera.width) * camera.height;
  const double squared_radius =
      kInliersAround * area_px / (M_PI * static_cast<double>(inliers.size()));
  std::vector<int> isolated;
  int num_missing = 0;
  for (std::size_t i = 0; i < prev.points.size(); ++i) {
    if (found[i] || prev.points[i].far) continue;
    ++num_missing;
    const Eigen::Vector2f& pixel = leftPixel(prev, prev.points[i]);
    const auto isNear = [&](const MatchedPoint& match) {
      return (leftPixel(prev, prev.points[match.prev]) - pixel).squaredNorm() < squared_radius;
    };
    if (std::none_of(inliers.begin(), inliers.end(), isNear))
      isolated.push_back(static_cast<int>(i));
  }
  if (static_cast<double>(isolated.size()) <
      std::max(kFewestIsolated, kShareIsolated * num_missing))
    return {};
  return isolated;
}

/// Whether depths are smaller than others, in the median and at the far end.
bool isNearer(const std::vector<double>& depths, const std::vector<double>& others) {
  for (const double share : {0.5, 0.9}) {
    if (!(quantile(depths, share) < quantile(others, share))) return false;
  }
  return true;
}

}  // namespace

RestingFeatures::RestingFeatures(const StereoCamera& camera)
    : last_px_(static_cast<float>(camera.width - 1), static_cast<float>(camera.height - 1)),
      cells_(camera.width, camera.height, kCellSize_px) {}

void RestingFeatures::leaveOut(StereoFrame* frame) const {
  const auto first_resting = std::stable_partition(
      frame->points.begin(), frame->points.end(),
      [&](const StereoPoint& point) { return !rests(leftPixel(*frame, point)); });
  frame->resting_points.insert(frame->resting_points.end(), first_resting, frame->points.end());
  frame->points.erase(first_resting, frame->points.end());
  frame->lines.erase(std::remove_if(frame->lines.begin(), frame->lines.end(),
                                    [&](const StereoLine& line) {
                                      return rests(frame->features.lines_left[line.left].segment);
                                    }),
                     frame->lines.end());
}

void RestingFeatures::learn(const StereoFrame& prev, const StereoFrame& curr,
                            const TrackingResult& tracked, const FrameContext& context) {
  lost_s_ = 0.0;
  share_found_ += kWeightOfFrame * (shareFound(prev, context.camera, tracked) - share_found_);
  countResting(prev, curr, tracked.motion.T_curr_prev, context);
}

/// Counts the points of the previous frame that a motion should have moved: those that are found
/// where they were, and the others.
void RestingFeatures::countResting(const StereoFrame& prev, const StereoFrame& curr,
                                   const Eigen::Isometry3d& T_curr_prev,
                                   const FrameContext& context) {
  std::vector<const StereoPoint*> found;
  std::vector<Eigen::Vector2f> pixels;
  std::vector<Descriptor> descriptors;
  for (const std::vector<StereoPoint>* points : {&curr.points, &curr.resting_points}) {
    for (const StereoPoint& point : *points) {
      found.push_back(&point);
      pixels.push_back(leftPixel(curr, point));
      descriptors.push_back(curr.features.points_left[point.left].descriptor);
    }
  }
  const Eigen::Isometry3d rest = Eigen::Isometry3d::Identity();
  PointGrid grid(kCellSize_px, kCellSize_px);
  grid.fill(pixels, descriptors);
  for (const std::vector<StereoPoint>* points : {&prev.points, &prev.resting_points}) {
    for (const StereoPoint& point : *points) {
      if (shiftBetween(prev, point, T_curr_prev, rest, context) < kMoves_px) continue;
      const Keypoint& left = prev.features.points_left[point.left];
      const auto radius = static_cast<float>(kRests_px * levelScaleOf(prev, point, context));
      const Eigen::Vector2f corner(radius, radius);
      const TwoNearest nearest =
          grid.nearest(left.descriptor, {left.pixel - corner, left.pixel + corner},
                       [&](int i, const Eigen::Vector2f&) {
                         return std::abs(found[i]->right_px.x() - point.right_px.x()) <= radius;
                       });
      const bool rests = nearest.best <= context.parameters.matching.max_point_distance;
      count(rests, &cells_.at(left.pixel));
    }
  }
}

std::optional<RestingFeatures::StationaryMotion> RestingFeatures::findStationary(
    const StereoFrame& prev, const TrackingResult& tracked, const FrameContext& context,
    double most_found, double least_resting) const {
  if (!tracked.frame_to_frame.ok() || shareFound(prev, context.camera, tracked) > most_found)
    return std::nullopt;
  StationaryMotion motion;
  motion.inliers = matchedInliers(tracked, prev, context);
  motion.resting = restingOf(motion.inliers, prev);
  const double least =
      std::max<double>(kMinConsensus, least_resting * static_cast<double>(motion.inliers.size()));
  if (static_cast<double>(motion.resting.size()) < least) return std::nullopt;
  return motion;
}

std::optional<RestingBody> RestingFeatures::findBeforeScene(const StereoFrame& prev,
                                                            const StereoFrame& curr,
                                                            const TrackingResult& tracked,
                                                            const FrameContext& context,
                                                            ThreadPool* threads) const {
  const double share = has_body_ ? 0.5 * kShareOfInliers : kShareOfInliers;
  const std::optional<StationaryMotion> motion =
      findStationary(prev, tracked, context, kShareWithBody, share);
  if (!motion && shareFound(prev, context.camera, tracked) >= kShareFound) return std::nullopt;
  const TrackingResult none;
  std::vector<MatchedPoint> matches =
      matchOthers(prev, curr, motion ? tracked : none, context, threads);
  double num_inliers = 0.0;
  if (motion) {
    matches.insert(matches.end(), motion->inliers.begin(), motion->inliers.end());
    num_inliers = static_cast<double>(motion->inliers.size());
  }
  const std::vector<int> resting = restingOf(matches, prev);
  const double least = std::max<double>(kMinConsensus, share * num_inliers);
  // Where the scene is slow, hardly anything moves much.
  for (const Speed& speed : {kFast, kSlow}) {
    const std::optional<MovingScene> scene = findMovingScene(matches, speed.scene_px, context);
    if (!scene) continue;
    const auto num_scene = static_cast<int>(scene->depths.size());
    if (num_scene < kShareOfMovingScene * num_inliers) continue;
    std::vector<int> body = bodyBefore(*scene, resting, prev, tracked, speed, context);
    if (static_cast<double>(body.size()) >= least && isNearer(depthsOf(body, prev), scene->depths))
      return RestingBody{std::move(body), scene->T_curr_prev, num_scene};
  }
  return std::nullopt;
}

bool RestingFeatures::mayHideScene(const StereoFrame& prev, const TrackingResult& tracked,
                                   const FrameContext& context) const {
  const std::optional<StationaryMotion> motion =
      findStationary(prev, tracked, context, kShareStationary, kShareOfInliers);
  if (!motion) return false;
  const std::vector<double> depths = depthsOf(motion->resting, prev);
  if (median(depths) > kFarthestBody_m) return false;
  const std::vector<int> isolated = isolatedPoints(motion->inliers, prev, context.camera);
  return !isolated.empty() && isNearer(depths, depthsOf(isolated, prev));
}

bool RestingFeatures::confirm(const std::optional<RestingBody>& body, const StereoFrame& prev,
                              const StereoFrame& curr, const FrameContext& context) {
  const bool again = curr.stamp_ns == confirmed_ns_;
  confirmed_ns_ = curr.stamp_ns;
  if (!body) {
    if (!again) num_scene_ /= 2;
    return false;
  }
  num_scene_ = again ? std::max(num_scene_, body->num_scene) : num_scene_ + body->num_scene;
  if (num_scene_ < kMinScene) return false;
  num_scene_ = 0;
  has_body_ = true;
  for (const int i : body->points) {
    for (int k = 0; k < kFewestPoints; ++k)
      count(true, &cells_.at(leftPixel(prev, prev.points[i])));
  }
  if (!again) countResting(prev, curr, body->T_curr_prev, context);
  return true;
}

void RestingFeatures::addLost(double dt_s) {
  constexpr double kForgotten_s = 10.0;
  lost_s_ += dt_s;
  if (lost_s_ <= kForgotten_s) return;
  cells_.fill(Counts());
  has_body_ = false;
}

void RestingFeatures::count(bool rests, Counts* counts) {
  constexpr int kMost = 16;
  std::uint8_t& counter = rests ? counts->rested : counts->moved;
  if (++counter < kMost) return;
  counts->rested /= 2;
  counts->moved /= 2;
}

/// Of the cell of a pixel and the next `cells` in each direction.
RestingFeatures::Sums RestingFeatures::around(const Eigen::Vector2f& pixel, int cells) const {
  Sums sums;
  for (int y = -cells; y <= cells; ++y) {
    for (int x = -cells; x <= cells; ++x) {
      const Eigen::Vector2f p = pixel + (kCellSize_px * Eigen::Vector2i(x, y)).cast<float>();
      if (p.minCoeff() < 0.0F || (last_px_ - p).minCoeff() < 0.0F) continue;
      sums.rested += cells_.at(p).rested;
      sums.moved += cells_.at(p).moved;
    }
  }
  return sums;
}

bool RestingFeatures::rests(const Eigen::Vector2f& pixel) const {
  const double least =
      has_body_ ? std::min(kShareResting, kShareOfFound * share_found_) : kShareResting;
  const int most_cells = has_body_ ? kMostCells : 1;
  Sums sums;
  for (int cells = 1; cells <= most_cells; ++cells) {
    sums = around(pixel, cells);
    if (std::max<double>(sums.rested, least * (sums.rested + sums.moved)) >= kFewestPoints) break;
  }
  return sums.rested >= kFewestPoints && sums.rested > least * (sums.rested + sums.moved);
}

/// Points of the previous frame that rest, where what rests may be none of the scene.
std::vector<int> RestingFeatures::restingOf(const std::vector<MatchedPoint>& matches,
                                            const StereoFrame& prev) const {
  std::vector<int> resting;
  for (const MatchedPoint& match : matches) {
    if (match.shift_px < kRests_px && mayRest(leftPixel(prev, prev.points[match.prev])))
      resting.push_back(match.prev);
  }
  return resting;
}

/// Whether half of a segment or more lies where features rest.
bool RestingFeatures::rests(const LineSegment& segment) const {
  constexpr int kSamples = 8;
  int resting = 0;
  for (int k = 0; k < kSamples; ++k) {
    const float along = (static_cast<float>(k) + 0.5F) / kSamples;
    resting +=
        rests(Eigen::Vector2f(segment.start + along * (segment.end - segment.start))) ? 1 : 0;
  }
  return 2 * resting >= kSamples;
}

/// False where the scene was seen to move: it does not rest but with the camera.
bool RestingFeatures::mayRest(const Eigen::Vector2f& pixel) const {
  return around(pixel, 1).moved < kFewestPoints || rests(pixel);
}

}  // namespace point_line_odometry
