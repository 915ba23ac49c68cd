#include "odometry/coarser_points.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "map/new_landmarks.h"
#include "matching/correlation_matcher.h"
#include "matching/index_pair.h"
#include "motion/motion_consensus.h"
#include "motion/observations.h"
#include "odometry/stereo_triangulation.h"

namespace point_line_odometry {
namespace {

constexpr double kShareOfCell = 0.2;  // points in a cell / points/max_per_cell

// Where cells may keep fewer points than this, one stereo point is not few.
constexpr int kManyPoints = 8;

// With a correct prediction at least a third of the points is tracked and agrees, with a wrong one
// at most a fifth.
constexpr double kShareAgreeing = 0.25;

// A turn by a third of the field of view is found. With 0.2, 40 px and levels from 3.5 on, flights
// along plain and plaster walls are lost at every 6th to 8th frame; with levels from 3.5 on alone,
// that along plaster at every 7th.
constexpr double kWideRadius = 0.35;         // search radius / width of the image
constexpr float kWideLevelRadius = 60.0F;    // [px of a level]
constexpr float kWideMinScale = 2.5F;        // of the levels searched so: finer ones take long
constexpr double kConsensusRadiusPx = 12.0;  // around the consensus of these levels

/// Collects stereo pairs of keypoints of coarser levels for a frame, where it has few points.
class CoarserPairs {
 public:
  CoarserPairs(const PointCoverage& coverage, const FrameContext& context,
               DetectedFeatures* features)
      : coverage_(coverage),
        image_(Eigen::Vector2f::Zero(), Eigen::Vector2f(context.left.levels.front().cols - 1,
                                                        context.left.levels.front().rows - 1)),
        max_count_(std::max(1, cvRound(kShareOfCell * context.parameters.points.max_per_cell))),
        buckets_(context.camera, context.parameters.points.cell_size_px),
        features_(features) {}

  /// Reserves a place for a point; false if the image has enough points there.
  bool reserve(const Eigen::Vector2f& left_px) {
    return image_.contains(left_px) && coverage_.isShortAt(left_px) &&
           buckets_.take(left_px, max_count_);
  }

  void add(const Keypoint& left, const Eigen::Vector2f& right_px) {
    pairs_.push_back({static_cast<int>(features_->points_left.size()),
                      static_cast<int>(features_->points_right.size())});
    features_->points_left.push_back(left);
    features_->points_right.push_back(left);  // the patch correlates: so does its description
    features_->points_right.back().pixel = right_px;
  }

  const std::vector<IndexPair>& pairs() const { return pairs_; }

 private:
  const PointCoverage& coverage_;
  Eigen::AlignedBox2f image_;
  int max_count_;
  PointBuckets buckets_;
  DetectedFeatures* features_;
  std::vector<IndexPair> pairs_;
};

bool isCoarser(const StereoFrame& frame, const StereoPoint& point) {
  return frame.features.points_left[point.left].octave > 0;
}

/// The motion on which most of the tracked points agree.
MotionConsensus consensusOf(const std::vector<TrackedPoint>& tracked, const StereoFrame& previous,
                            const FrameContext& context) {
  std::vector<PointCorrespondence> matches;
  for (const TrackedPoint& point : tracked) {
    const StereoPoint& before = previous.points[static_cast<std::size_t>(point.previous)];
    if (before.far) continue;
    const double sigma_px =
        levelScale(previous.features.points_left[before.left], context.parameters);
    matches.push_back({pointObservation(point.left_px, point.right_px, sigma_px, context),
                       before.triangulated.p_camera});
  }
  return findConsensus(matches, context.camera).value_or(MotionConsensus());
}

/// Tracks points near their prediction. Where too few of them agree on a motion, the prediction is
/// wrong: those of the coarsest levels are searched in a large part of the image, and all near the
/// motion on which these agree.
std::vector<TrackedPoint> track(const TrackingStart& start, const FrameContext& context,
                                ThreadPool* threads) {
  const StereoFrame& previous = start.previous;
  const auto trackIn = [&](CorrelationSearch search) {
    search.prediction.shutter = context.shutter;
    return trackByCorrelation(previous, context.left, context.right, context.masks, context.camera,
                              search, threads);
  };
  std::vector<TrackedPoint> tracked = trackIn({start.prediction});
  if (!context.parameters.matching.wide_search) return tracked;
  const auto num_points = std::count_if(
      previous.points.begin(), previous.points.end(),
      [&](const StereoPoint& point) { return !point.far && isCoarser(previous, point); });
  const int num_agreeing = consensusOf(tracked, previous, context).num_inliers;
  if (num_agreeing >= kShareAgreeing * static_cast<double>(num_points)) return tracked;

  CorrelationSearch wide;
  wide.prediction = {start.prediction.T_curr_prev, kWideRadius * context.camera.width};
  wide.max_level_radius = kWideLevelRadius;
  wide.min_scale = kWideMinScale;
  const MotionConsensus consensus = consensusOf(trackIn(wide), previous, context);
  std::vector<TrackedPoint> retried = trackIn({{consensus.T_curr_prev, kConsensusRadiusPx}});
  return consensusOf(retried, previous, context).num_inliers > num_agreeing ? retried : tracked;
}

/// Points of the previous frame, which keep their descriptors: so they are matched with it.
void trackPoints(const TrackingStart& start, const FrameContext& context, ThreadPool* threads,
                 CoarserPairs* pairs) {
  const StereoFrame& previous = start.previous;
  for (const TrackedPoint& point : track(start, context, threads)) {
    if (!pairs->reserve(point.left_px)) continue;
    Keypoint left = previous.features.points_left[previous.points[point.previous].left];
    left.pixel = point.left_px;
    pairs->add(left, point.right_px);
  }
}

void detectPoints(StereoFeatureDetector* detector, const FrameContext& context, ThreadPool* threads,
                  CoarserPairs* pairs) {
  const std::vector<Keypoint> corners = detector->detectCoarserPoints(
      context.left, threads, context.masks.left,
      [pairs](const Keypoint& corner) { return pairs->reserve(corner.pixel); });
  const std::vector<std::optional<Eigen::Vector2f>> partners = matchStereoByCorrelation(
      corners, context.left, context.right, context.masks, context.parameters.matching, threads);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (partners[i]) pairs->add(corners[i], *partners[i]);
  }
}

}  // namespace

PointCoverage::PointCoverage(const StereoFrame& frame, const FrameContext& context)
    : counts_(frame.left_image.levels.front().cols, frame.left_image.levels.front().rows,
              context.parameters.points.cell_size_px),
      few_(context.parameters.points.max_per_cell < kManyPoints ? 1 : 2) {
  for (const StereoPoint& point : frame.points) {
    if (!point.far) ++counts_.at(frame.features.points_left[point.left].pixel);
  }
  if (!context.masks.left.empty()) leaveOutMasked(context);
}

/// A cell that is mostly masked cannot have many points.
void PointCoverage::leaveOutMasked(const FrameContext& context) {
  constexpr double kLeastShare = 0.5;
  const cv::Mat& allowed = context.masks.left.points();
  const int side = context.parameters.points.cell_size_px;
  const cv::Rect image({0, 0}, allowed.size());
  for (int y = 0; y < image.height; y += side) {
    for (int x = 0; x < image.width; x += side) {
      const cv::Rect cell = cv::Rect(x, y, side, side) & image;
      if (cv::countNonZero(allowed(cell)) >= kLeastShare * cell.area()) continue;
      counts_.at(Eigen::Vector2f(static_cast<float>(x), static_cast<float>(y))) = kMasked;
    }
  }
}

bool PointCoverage::isPoor() const {
  constexpr double kManyCells = 0.6;  // half the cells have few points with sky and a plain road
  const std::vector<int>& counts = counts_.cells();
  const auto few = std::count_if(counts.begin(), counts.end(),
                                 [this](int n) { return n < few_ && n != kMasked; });
  const auto masked = std::count(counts.begin(), counts.end(), kMasked);
  return static_cast<double>(few) >
         kManyCells * static_cast<double>(static_cast<std::ptrdiff_t>(counts.size()) - masked);
}

bool hasCoarserPoints(const StereoFrame& frame) {
  return std::any_of(frame.points.begin(), frame.points.end(),
                     [&](const StereoPoint& point) { return isCoarser(frame, point); });
}

void addCoarserPoints(StereoFeatureDetector* detector, const std::optional<TrackingStart>& start,
                      const PointCoverage& coverage, const FrameContext& context,
                      ThreadPool* threads, StereoFrame* frame) {
  CoarserPairs pairs(coverage, context, &frame->features);
  if (start) trackPoints(*start, context, threads, &pairs);
  detectPoints(detector, context, threads, &pairs);
  triangulatePoints(pairs.pairs(), context, threads, frame);
}

}  // namespace point_line_odometry
