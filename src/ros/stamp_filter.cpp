#include "ros/stamp_filter.h"

#include <algorithm>
#include <iomanip>
#include <sstream>
#include <utility>

#include "point_line_odometry/types.h"
#include "ros/confirmation.h"
#include "ros/conversions.h"
#include "ros/frame_processor.h"

namespace point_line_odometry {
namespace {

constexpr std::int64_t kSecond_ns = 1000000000;

constexpr auto kMaxLateness_ns = static_cast<std::int64_t>(1e9 * kMaxLateness_s);

/// A longer step forwards is a jump, unless the camera's rate is lower [ns].
constexpr std::int64_t kMaxUsualStep_ns = kSecond_ns;

/// Largest step between stamps that confirm each other [ns]: the upper limit of
/// tracking/max_frame_gap_s.
constexpr std::int64_t kMaxConfirmingStep_ns = 60 * kSecond_ns;

/// A slow camera may miss two frames in a row.
constexpr std::int64_t kMaxStepInPeriods = 3;

/// A first stamp further ahead of the computer's clock must be confirmed [ns].
constexpr std::int64_t kMaxAhead_ns = 3600 * kSecond_ns;

/// One day before the end of ros::Time, as tf and others add the length of their buffers to stamps.
constexpr std::uint32_t kLastSecond = 4294967295U - 86400U;

/// The fault of a stamp that does not depend on other stamps.
std::optional<StampFault> faultOf(const ros::Time& stamp) {
  if (stamp.isZero()) return StampFault::kZero;
  if (stamp.nsec >= kSecond_ns || stamp.sec > kLastSecond) return StampFault::kOutOfRange;
  return std::nullopt;
}

const char* toString(StampFault fault) {
  switch (fault) {
    case StampFault::kZero:
      return "is no valid time";
    case StampFault::kOutOfRange:
      return "is out of the valid range";
    case StampFault::kUnconfirmedJump:
      break;
  }
  return "is far from those before and after it";
}

}  // namespace

std::string StampFilter::Rejection::text() const {
  std::ostringstream text;
  text << "stamp " << stamp.sec << "." << std::setw(9) << std::setfill('0') << stamp.nsec << " "
       << toString(fault);
  return text.str();
}

StampFilter::StampFilter() : max_step_ns_(kMaxUsualStep_ns) {}

StampFilter::Decision StampFilter::add(const ros::Time& stamp, const ros::Time& now,
                                       Deliver deliver) {
  Decision decision;
  if (const auto fault = faultOf(stamp)) {
    decision.rejected.push_back({stamp, *fault});
    return decision;
  }
  const std::int64_t stamp_ns = toNanoseconds(stamp);
  if (continues(stamp_ns, now)) {
    rejectHeld(&decision);
    newest_ns_ = std::max(newest_ns_.value_or(stamp_ns), stamp_ns);
    decision.passed.push_back(std::move(deliver));
    return decision;
  }
  if (!risesFromHeld(stamp_ns)) rejectHeld(&decision);
  held_.push_back({stamp, stamp_ns, std::move(deliver)});
  if (held_.size() >= kConfirmations) confirm(&decision);
  return decision;
}

StampFilter::Decision StampFilter::flush() {
  constexpr std::int64_t kLongestPause_ns = 3'600'000'000'000;
  Decision decision;
  if (held_.empty()) return decision;
  const std::int64_t pause_ns =
      held_.front().stamp_ns - newest_ns_.value_or(held_.front().stamp_ns);
  if (pause_ns >= 0 && pause_ns <= kLongestPause_ns) {
    confirm(&decision);
  } else {
    rejectHeld(&decision);
  }
  return decision;
}

bool StampFilter::continues(std::int64_t stamp_ns, const ros::Time& now) const {
  if (newest_ns_) {
    const std::int64_t step_ns = stamp_ns - *newest_ns_;
    return step_ns >= -kMaxLateness_ns && step_ns <= max_step_ns_;
  }
  return now.isZero() || stamp_ns <= toNanoseconds(now) + kMaxAhead_ns;
}

bool StampFilter::risesFromHeld(std::int64_t stamp_ns) const {
  if (held_.empty()) return true;
  const std::int64_t step_ns = stamp_ns - held_.back().stamp_ns;
  return step_ns > 0 && step_ns <= kMaxConfirmingStep_ns;
}

void StampFilter::confirm(Decision* decision) {
  std::int64_t longest_ns = 0;
  for (std::size_t i = 1; i < held_.size(); ++i) {
    longest_ns = std::max(longest_ns, held_[i].stamp_ns - held_[i - 1].stamp_ns);
  }
  max_step_ns_ = std::max(kMaxUsualStep_ns, kMaxStepInPeriods * longest_ns);
  const std::int64_t first_ns = held_.front().stamp_ns;
  decision->jump_s = toSeconds(first_ns - newest_ns_.value_or(first_ns));
  newest_ns_ = held_.back().stamp_ns;
  for (Held& held : held_) decision->passed.push_back(std::move(held.deliver));
  held_.clear();
}

void StampFilter::rejectHeld(Decision* decision) {
  for (const Held& held : held_) {
    decision->rejected.push_back({held.stamp, StampFault::kUnconfirmedJump});
  }
  held_.clear();
}

}  // namespace point_line_odometry
