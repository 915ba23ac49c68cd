#include "matching/sequence_check.h"

#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "common/same_image.h"
#include "common/statistics.h"
#include "matching/patch_aligner.h"
#include "matching/rolling_shutter.h"
#include "matching/wide_matches.h"

namespace point_line_odometry {
namespace {

constexpr double kMadToSigma = 1.4826;

/// A measurement y = slope x + a combination of other terms.
struct Sample {
  double y = 0.0;
  double x = 0.0;
  Eigen::RowVectorXd others;
};

/// Samples with the same coefficients of the other terms.
using Group = std::vector<Sample>;

/// What the other terms do not explain.
struct Residuals {
  Eigen::VectorXd y;
  Eigen::VectorXd x;

  double deviation(Eigen::Index i, double slope) const { return std::abs(y[i] - slope * x[i]); }
};

/// Eliminates the other terms (Frisch and Waugh 1933). Nothing of a group that hardly has more
/// samples than terms.
Residuals eliminateOthers(const Group& group) {
  const auto rows = static_cast<Eigen::Index>(group.size());
  if (rows == 0 || rows < 3 * group.front().others.size()) return {};
  Eigen::MatrixXd others(rows, group.front().others.size());
  Residuals residuals{Eigen::VectorXd(rows), Eigen::VectorXd(rows)};
  for (Eigen::Index i = 0; i < rows; ++i) {
    const Sample& sample = group[static_cast<std::size_t>(i)];
    others.row(i) = sample.others;
    residuals.y[i] = sample.y;
    residuals.x[i] = sample.x;
  }
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(others);
  residuals.y -= others * qr.solve(residuals.y);
  residuals.x -= others * qr.solve(residuals.x);
  return residuals;
}

/// Without the samples more than three sigma off.
Group withoutOutliers(const Group& group, const Residuals& residuals, double slope) {
  std::vector<double> deviations;
  for (Eigen::Index i = 0; i < residuals.y.size(); ++i) {
    deviations.push_back(residuals.deviation(i, slope));
  }
  const double most = 3.0 * kMadToSigma * median(deviations);
  Group kept;
  for (std::size_t i = 0; i < deviations.size(); ++i) {
    if (deviations[i] <= most) kept.push_back(group[i]);
  }
  return kept;
}

/// The slope that all groups have in common; its variance is that of the groups' scatter, since
/// errors are alike within one.
std::optional<SequenceDelay> commonSlope(std::vector<Group> groups) {
  constexpr int kRounds = 4;
  constexpr int kFewestGroups = 4;
  std::vector<Residuals> residuals(groups.size());
  SequenceDelay delay;
  for (int round = 0; round < kRounds; ++round) {
    double xx = 0.0;
    double xy = 0.0;
    int used = 0;
    for (std::size_t g = 0; g < groups.size(); ++g) {
      if (round > 0) groups[g] = withoutOutliers(groups[g], residuals[g], delay.seconds);
      residuals[g] = eliminateOthers(groups[g]);
      xx += residuals[g].x.squaredNorm();
      xy += residuals[g].x.dot(residuals[g].y);
      if (residuals[g].x.size() > 0) ++used;
    }
    if (used < kFewestGroups || xx <= 0.0) return std::nullopt;
    delay.seconds = xy / xx;
    double scatter = 0.0;
    for (const Residuals& r : residuals) {
      const double deviation = r.x.dot(r.y) - delay.seconds * r.x.squaredNorm();
      scatter += deviation * deviation;
    }
    delay.variance = scatter / (xx * xx) * used / (used - 1.0);
  }
  return delay;
}

std::optional<SequenceDelay> combined(const std::optional<SequenceDelay>& a,
                                      const std::optional<SequenceDelay>& b) {
  if (!a || !b) return a ? a : b;
  const double sum = a->variance + b->variance;
  if (sum <= 0.0) return a;
  return SequenceDelay{(a->seconds * b->variance + b->seconds * a->variance) / sum,
                       a->variance * b->variance / sum};
}

/// A camera that drops frames has periods of one, two, three of its intervals; those of frames that
/// are stamped when they arrive are a fraction of one.
int countEarly(const std::vector<double>& periods_s) {
  constexpr double kShare = 0.25;
  int count = 0;
  for (std::size_t i = 1; i + 1 < periods_s.size(); ++i) {
    if (periods_s[i] < kShare * std::min(periods_s[i - 1], periods_s[i + 1])) ++count;
  }
  return count;
}

}  // namespace

bool SequenceMeasurement::notSimultaneous() const {
  constexpr double kSigmas = 6.0;
  constexpr double kLeast_s = 1e-3;
  constexpr double kLeastShift_px = 0.3;
  if (!delay_s) return false;
  const double amount_s = std::abs(*delay_s);
  return amount_s > kSigmas * delay_sigma_s && amount_s > kLeast_s &&
         amount_s * speed_px_s > kLeastShift_px;
}

bool SequenceMeasurement::hasRollingShutter() const {
  constexpr double kSigmas = 4.0;
  constexpr double kLeastShare = 0.1;  // cameras take a third of their period or more
  constexpr double kLeastShift_px = 0.3;
  if (!read_out_s) return false;
  const double amount_s = std::abs(*read_out_s);
  return amount_s > kSigmas * read_out_sigma_s && amount_s > kLeastShare * period_s &&
         0.5 * amount_s * speed_px_s > kLeastShift_px;
}

bool SequenceMeasurement::hasArrivalStamps() const {
  constexpr int kFewest = 3;  // a single hiccup is none
  constexpr int kLeastPercent = 3;
  return early >= kFewest && 100 * early > kLeastPercent * frames;
}

bool SequenceMeasurement::hasRestingPattern() const {
  // Without a projector at most one of thousands rests.
  constexpr int kFewestResting = 20;
  constexpr int kLeastPercent = 2;
  constexpr int kFewestCells = 5;  // not a bonnet, a robot's arm or dirt
  return resting >= kFewestResting && 100 * resting > kLeastPercent * compared &&
         resting_cells >= kFewestCells;
}

void SequenceCheck::add(const StereoImages& rectified) {
  const bool usable = rectified.left.type() == CV_8UC1 && !rectified.left.empty() &&
                      rectified.right.type() == CV_8UC1 &&
                      rectified.right.size() == rectified.left.size();
  if (!usable) {
    last_left_ = last_right_ = cv::Mat();
    same_pairs_ = 0;
    return;
  }
  ++pairs_;
  if (!countRepeated(rectified)) return;
  Frame frame;
  frame.size = rectified.left.size();
  std::vector<Keypoint> keypoints = detectUnmasked(rectified.left, rectified.left_mask);
  for (const Keypoint& keypoint : keypoints) {
    Point point;
    point.pixel = keypoint.pixel.cast<double>();
    frame.points.push_back(point);
  }
  matchStereo(rectified, keypoints, &frame);
  const double period_s = toSeconds(rectified.stamp_ns - last_stamp_ns_);
  if (last_left_.size() == rectified.left.size() && period_s > 0.0) {
    frames_.back().period_s = period_s;
    track(rectified.left, keypoints, &frames_.back());
    fitField(&frames_.back());
  }
  frames_.push_back(std::move(frame));
  last_left_ = rectified.left.clone();
  last_right_ = rectified.right.clone();
  last_keypoints_ = std::move(keypoints);
  last_stamp_ns_ = rectified.stamp_ns;
}

void SequenceCheck::matchStereo(const StereoImages& images, const std::vector<Keypoint>& left,
                                Frame* frame) {
  constexpr float kRows_px = 8.0F;
  const std::vector<Keypoint> right = detectUnmasked(images.right, images.right_mask);
  for (const auto& [l, r] : matchInBand(left, right, kRows_px)) {
    const auto aligned =
        PatchAligner(images.left, left[l].pixel).alignSlanted(images.right, right[r].pixel);
    if (!aligned) continue;
    Point& point = frame->points[l];
    const Eigen::Vector2d shift = aligned->pixel.cast<double>() - point.pixel;
    point.disparity = -shift.x();
    point.vertical_disparity = shift.y();
    point.matched = true;
  }
}

void SequenceCheck::track(const cv::Mat& left, const std::vector<Keypoint>& keypoints,
                          Frame* from) const {
  for (const auto& [a, b] : matchInBand(last_keypoints_, keypoints, wideBand_px(left.rows))) {
    const auto aligned =
        PatchAligner(last_left_, last_keypoints_[a].pixel).align(left, keypoints[b].pixel);
    if (!aligned) continue;
    Point& point = from->points[a];
    point.next = static_cast<int>(b);
    point.flow = aligned->pixel.cast<double>() - point.pixel;
  }
}

/// Terms of a motion field: quadratic in the image, and linear in the disparity with coefficients
/// that are linear in the image, as rotation and translation of a camera give (Longuet-Higgins and
/// Prazdny 1980), and its square.
SequenceCheck::Terms SequenceCheck::terms(const Frame& frame, const Point& point) {
  constexpr double kUsualShare = 0.1;  // disparity to width: terms of similar size
  const double half_width = 0.5 * frame.size.width;
  const double x = point.pixel.x() / half_width - 1.0;
  const double y = (point.pixel.y() - 0.5 * frame.size.height) / half_width;
  const double d = point.disparity / (kUsualShare * frame.size.width);
  Terms terms;
  terms << 1.0, x, y, x * x, x * y, y * y, d, d * x, d * y, d * d;
  return terms;
}

void SequenceCheck::fitField(Frame* frame) {
  constexpr int kRounds = 6;
  constexpr int kFewest = 40;
  constexpr double kLeastCut_px = 0.3;
  std::vector<const Point*> points;
  for (const Point& point : frame->points) {
    if (point.followed()) points.push_back(&point);
  }
  const std::vector<const Point*> all = points;
  Eigen::Matrix<double, 10, 2> field;
  for (int round = 0; round < kRounds; ++round) {
    const auto rows = static_cast<Eigen::Index>(points.size());
    if (rows < kFewest) return;
    Eigen::Matrix<double, Eigen::Dynamic, 10> design(rows, 10);
    Eigen::MatrixX2d flows(rows, 2);
    for (Eigen::Index i = 0; i < rows; ++i) {
      design.row(i) = terms(*frame, *points[static_cast<std::size_t>(i)]);
      flows.row(i) = points[static_cast<std::size_t>(i)]->flow.transpose();
    }
    field = design.colPivHouseholderQr().solve(flows);
    std::vector<double> deviations;
    for (const Point* point : all) {
      deviations.push_back((terms(*frame, *point) * field - point->flow.transpose()).norm());
    }
    const double most = std::max(kLeastCut_px, 3.0 * median(deviations));
    points.clear();
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (deviations[i] <= most) points.push_back(all[i]);
    }
  }
  frame->field = field / frame->period_s;
}

/// Vertical disparities by the vertical velocities, each part of the image with a calibration error
/// of its own.
std::optional<SequenceDelay> SequenceCheck::delayByRows() const {
  constexpr int kColumns = 6;
  constexpr int kRows = 4;
  std::vector<Group> groups(kColumns * kRows);
  for (std::size_t t = 1; t < frames_.size(); ++t) {
    const Frame& before = frames_[t - 1];
    const Frame& frame = frames_[t];
    if (before.period_s <= 0.0 || !before.field || !frame.field) continue;
    const Field field = 0.5 * (*before.field + *frame.field);
    for (const Point& point : frame.points) {
      if (!point.matched) continue;
      const Terms by = terms(frame, point);
      Sample sample{point.vertical_disparity, by.dot(field.col(1)), Eigen::RowVectorXd(3)};
      sample.others << 1.0, by[6], by[8];
      groups[cellOf(frame, point, kColumns, kRows)].push_back(std::move(sample));
    }
  }
  return commonSlope(std::move(groups));
}

/// Changes of the disparities by the changes of the horizontal velocities, each frame with a camera
/// motion of its own.
std::optional<SequenceDelay> SequenceCheck::delayByColumns() const {
  std::vector<Group> groups;
  for (std::size_t t = 1; t + 1 < frames_.size(); ++t) {
    const Frame& before = frames_[t - 1];
    const Frame& frame = frames_[t];
    const Frame& after = frames_[t + 1];
    const bool whole = before.period_s > 0.0 && frame.period_s > 0.0;
    if (!whole || !before.field || !after.field) continue;
    const Field change = 0.5 * (*after.field - *before.field);
    Group group;
    for (const Point& point : frame.points) {
      if (!point.matched || point.next < 0) continue;
      const Point& next = after.points[static_cast<std::size_t>(point.next)];
      if (!next.matched) continue;
      const Terms by = terms(frame, point);
      Sample sample{next.disparity - point.disparity, -by.dot(change.col(0)),
                    Eigen::RowVectorXd(4)};
      sample.others << 1.0, by[9], by[7], by[8];
      group.push_back(std::move(sample));
    }
    groups.push_back(std::move(group));
  }
  return commonSlope(std::move(groups));
}

std::size_t SequenceCheck::cellOf(const Frame& frame, const Point& point, int columns, int rows) {
  const auto part = [](double value, int size, int parts) {
    return std::clamp(static_cast<int>(value * parts / size), 0, parts - 1);
  };
  const int column = part(point.pixel.x(), frame.size.width, columns);
  const int row = part(point.pixel.y(), frame.size.height, rows);
  return static_cast<std::size_t>(row * columns + column);
}

/// Compares each point with those near it in the image and in depth that move alike: with none of
/// these, nothing can be said of it.
void SequenceCheck::countResting(const Frame& frame, SequenceMeasurement* measurement,
                                 std::vector<int>* cells) {
  constexpr double kLeastDisparity_px = 2.0;  // the horizon may rest while the ground moves
  constexpr double kResting_px = 0.5;
  constexpr double kMoving_px = 3.0;
  constexpr double kAlike_px = 1.5;
  const auto nearby = [&](const Point& a, const Point& b) {
    const double depth = std::max(1.5, 0.2 * a.disparity);
    return (a.pixel - b.pixel).norm() < frame.size.width / 8.0 &&
           std::abs(a.disparity - b.disparity) < depth;
  };
  const auto tracked = [](const Point& point) {
    return point.matched && point.next >= 0 && point.disparity >= kLeastDisparity_px;
  };
  for (const Point& point : frame.points) {
    if (!tracked(point)) continue;
    std::vector<Eigen::Vector2d> moving;
    for (const Point& other : frame.points) {
      if (!tracked(other) || other.flow.norm() < kMoving_px || !nearby(point, other)) continue;
      if (&other != &point) moving.push_back(other.flow);
    }
    const bool alike = std::any_of(moving.begin(), moving.end(), [&](const Eigen::Vector2d& a) {
      return std::count_if(moving.begin(), moving.end(), [&](const Eigen::Vector2d& b) {
               return (a - b).norm() < kAlike_px;
             }) >= 2;  // a itself, and one more
    });
    if (!alike) continue;
    ++measurement->compared;
    if (point.flow.norm() >= kResting_px) continue;
    ++measurement->resting;
    ++(*cells)[cellOf(frame, point, kRestingColumns, kRestingRows)];
  }
}

/// False for a pair of which one image is that of the pair before: it shows a wrong motion. A
/// camera without noise that is stationary repeats both, for longer than a driver does.
bool SequenceCheck::countRepeated(const StereoImages& rectified) {
  constexpr int kMostByDriver = 2;
  const bool left = isSameImage(rectified.left, last_left_);
  const bool right = isSameImage(rectified.right, last_right_);
  if (left && right) {
    ++same_pairs_;
    return true;
  }
  if (same_pairs_ <= kMostByDriver) {
    repeated_left_ += same_pairs_;
    repeated_right_ += same_pairs_;
  }
  same_pairs_ = 0;
  if (left) ++repeated_left_;
  if (right) ++repeated_right_;
  return !left && !right;
}

SequenceMeasurement SequenceCheck::measurement() const {
  constexpr double kFastest = 0.9;
  constexpr int kFewestInCell = 3;
  SequenceMeasurement measurement;
  measurement.frames = static_cast<int>(frames_.size());
  if (const auto delay = combined(delayByRows(), delayByColumns())) {
    measurement.delay_s = delay->seconds;
    measurement.delay_sigma_s = std::sqrt(delay->variance);
  }
  std::vector<const FollowedFrame*> tracked;
  std::vector<double> periods_s;
  for (const Frame& frame : frames_) {
    tracked.push_back(&frame);
    if (frame.period_s > 0.0) periods_s.push_back(frame.period_s);
  }
  measurement.early = countEarly(periods_s);
  measurement.period_s = median(std::move(periods_s));
  if (const auto read_out = left_ ? measureReadOut(tracked, *left_) : std::nullopt) {
    measurement.read_out_s = read_out->seconds;
    measurement.read_out_sigma_s = read_out->sigma_s;
  }
  std::vector<double> speeds;
  std::vector<int> cells(kRestingColumns * kRestingRows, 0);
  for (const Frame& frame : frames_) {
    for (const Point& point : frame.points) {
      if (point.matched && point.next >= 0) speeds.push_back(point.flow.norm() / frame.period_s);
    }
    countResting(frame, &measurement, &cells);
  }
  measurement.pairs = pairs_;
  measurement.repeated_left = repeated_left_;
  measurement.repeated_right = repeated_right_;
  measurement.speed_px_s = quantile(std::move(speeds), kFastest);
  measurement.resting_cells = static_cast<int>(
      std::count_if(cells.begin(), cells.end(), [](int n) { return n >= kFewestInCell; }));
  return measurement;
}

}  // namespace point_line_odometry
