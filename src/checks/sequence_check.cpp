#include "checks/sequence_check.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "checks/capture_delay.h"
#include "checks/read_out.h"
#include "checks/wide_matches.h"
#include "common/statistics.h"
#include "matching/patch_aligner.h"

namespace point_line_odometry {
namespace {

/// A camera that drops frames has periods of one, two, three of its intervals; those of frames that
/// are stamped when they arrive are a fraction of one.
int countBursts(const std::vector<double>& periods_s) {
  constexpr double kShare = 0.25;
  int count = 0;
  for (std::size_t i = 1; i + 1 < periods_s.size(); ++i) {
    if (periods_s[i] < kShare * std::min(periods_s[i - 1], periods_s[i + 1])) ++count;
  }
  return count;
}

/// Aligns points with those of the right image.
void matchStereo(const StereoImages& images, const std::vector<Keypoint>& left,
                 FollowedFrame* frame) {
  constexpr float kRows_px = 8.0F;
  const std::vector<Keypoint> right = detectUnmasked(images.right, images.right_mask);
  for (const auto& [l, r] : matchInBand(left, right, kRows_px)) {
    const auto aligned =
        PatchAligner(images.left, left[l].pixel).alignSlanted(images.right, right[r].pixel);
    if (!aligned) continue;
    FollowedPoint& point = frame->points[l];
    const Eigen::Vector2d shift = aligned->pixel.cast<double>() - point.pixel;
    point.disparity = -shift.x();
    point.vertical_disparity = shift.y();
    point.matched = true;
  }
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
  return bursts >= kFewest && 100 * bursts > kLeastPercent * frames;
}

void SequenceCheck::add(const StereoImages& rectified) {
  const bool usable = rectified.left.type() == CV_8UC1 && !rectified.left.empty() &&
                      rectified.right.type() == CV_8UC1 &&
                      rectified.right.size() == rectified.left.size();
  if (!usable) {
    last_left_ = cv::Mat();
    repetitions_.interrupt();
    return;
  }
  ++pairs_;
  if (repetitions_.add(rectified)) return;
  FollowedFrame frame;
  frame.size = rectified.left.size();
  std::vector<Keypoint> keypoints = detectUnmasked(rectified.left, rectified.left_mask);
  for (const Keypoint& keypoint : keypoints) {
    FollowedPoint point;
    point.pixel = keypoint.pixel.cast<double>();
    frame.points.push_back(point);
  }
  matchStereo(rectified, keypoints, &frame);
  const double period_s = toSeconds(rectified.stamp_ns - last_stamp_ns_);
  if (last_left_.size() == rectified.left.size() && period_s > 0.0) {
    frames_.back().period_s = period_s;
    track(rectified.left, keypoints, &frames_.back());
  }
  frames_.push_back(std::move(frame));
  last_left_ = rectified.left.clone();
  last_keypoints_ = std::move(keypoints);
  last_stamp_ns_ = rectified.stamp_ns;
}

void SequenceCheck::track(const cv::Mat& left, const std::vector<Keypoint>& keypoints,
                          FollowedFrame* from) const {
  for (const auto& [a, b] : matchInBand(last_keypoints_, keypoints, wideBand_px(left.rows))) {
    const auto aligned =
        PatchAligner(last_left_, last_keypoints_[a].pixel).align(left, keypoints[b].pixel);
    if (!aligned) continue;
    FollowedPoint& point = from->points[a];
    point.next = static_cast<int>(b);
    point.flow = aligned->pixel.cast<double>() - point.pixel;
  }
}

SequenceMeasurement SequenceCheck::measurement() const {
  constexpr double kFastest = 0.9;
  SequenceMeasurement measurement;
  measurement.frames = static_cast<int>(frames_.size());
  measurement.pairs = pairs_;
  measurement.repeated_left = repetitions_.left();
  measurement.repeated_right = repetitions_.right();
  std::vector<const FollowedFrame*> frames;
  std::vector<double> periods_s;
  std::vector<double> speeds;
  for (const FollowedFrame& frame : frames_) {
    frames.push_back(&frame);
    if (frame.period_s > 0.0) periods_s.push_back(frame.period_s);
    for (const FollowedPoint& point : frame.points) {
      if (point.followed()) speeds.push_back(point.flow.norm() / frame.period_s);
    }
  }
  measurement.bursts = countBursts(periods_s);
  measurement.period_s = median(std::move(periods_s));
  measurement.speed_px_s = quantile(std::move(speeds), kFastest);
  if (const auto delay = measureDelay(frames)) {
    measurement.delay_s = delay->seconds;
    measurement.delay_sigma_s = std::sqrt(delay->variance);
  }
  if (const auto read_out = left_ ? measureReadOut(frames, *left_) : std::nullopt) {
    measurement.read_out_s = read_out->seconds;
    measurement.read_out_sigma_s = read_out->sigma_s;
  }
  measurement.pattern = findRestingPattern(frames);
  return measurement;
}

}  // namespace point_line_odometry
