/// Times of frames from stamps as drivers give them.

#include "odometry/frame_clock.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "point_line_odometry/types.h"

namespace point_line_odometry {
namespace {

constexpr double kPeriod_s = 0.1;

std::int64_t nanoseconds(double seconds) { return std::llround(1e9 * seconds); }

/// Intervals between the times of frames with these stamps [s].
std::vector<double> intervals(const std::vector<double>& stamps_s) {
  FrameClock clock;
  std::vector<double> intervals_s;
  for (const double stamp_s : stamps_s) {
    const std::int64_t stamp_ns = nanoseconds(stamp_s);
    if (clock.stamp()) intervals_s.push_back(clock.secondsTo(stamp_ns));
    clock.add(stamp_ns);
    EXPECT_EQ(clock.stamp(), stamp_ns);
  }
  return intervals_s;
}

/// The times of frames with these intervals between their stamps are the stamps.
void expectStampsAreTimes(const std::vector<double>& wanted_s) {
  std::vector<double> stamps_s{5.0};
  for (const double interval_s : wanted_s) stamps_s.push_back(stamps_s.back() + interval_s);
  const std::vector<double> found_s = intervals(stamps_s);
  ASSERT_EQ(found_s.size(), wanted_s.size());
  for (std::size_t i = 0; i < wanted_s.size(); ++i) EXPECT_NEAR(found_s[i], wanted_s[i], 1e-8) << i;
}

TEST(FrameClock, BeginsWithTheFirstStamp) {
  const FrameClock clock;
  EXPECT_FALSE(clock.stamp());
  EXPECT_EQ(clock.timeOf(7), 7);
  EXPECT_EQ(clock.secondsTo(7), 0.0);
}

TEST(FrameClock, TakesSteadyStampsAsTheyAre) {
  expectStampsAreTimes(std::vector<double>(20, kPeriod_s));
  expectStampsAreTimes({0.1, 0.07, 0.13, 0.09, 0.12, 0.06, 0.1, 0.14});
}

TEST(FrameClock, TakesDroppedFramesAsTheyAre) {
  expectStampsAreTimes({0.1, 0.2, 0.1, 0.1, 0.3, 0.1, 0.2, 0.1, 0.2, 0.3, 0.1, 0.1});
  expectStampsAreTimes({0.1, 0.1, 0.1, 0.1, 0.9, 0.1, 0.1, 0.1, 5.0, 0.1, 0.1});
}

/// In pairs: the second of each is taken in the middle of the time.
TEST(FrameClock, DividesTheTimeBetweenFramesThatArriveTogether) {
  std::vector<double> stamps_s;
  for (int i = 0; i < 40; ++i) stamps_s.push_back(kPeriod_s * (i - i % 2) + 0.001 * (i % 2));
  const std::vector<double> found_s = intervals(stamps_s);
  for (std::size_t i = 8; i < found_s.size(); ++i) {
    EXPECT_GT(found_s[i], 0.4 * kPeriod_s) << i;
    EXPECT_LT(found_s[i], 1.6 * kPeriod_s) << i;
  }
}

/// After one that is late.
TEST(FrameClock, RunsAheadUntilTheStampsHaveCaughtUp) {
  FrameClock clock;
  for (int i = 0; i < 10; ++i) clock.add(nanoseconds(kPeriod_s * i));
  clock.add(nanoseconds(kPeriod_s * 10.9));
  const std::int64_t next_ns = nanoseconds(kPeriod_s * 11.0);
  EXPECT_NEAR(toSeconds(clock.timeOf(next_ns) - next_ns), 0.45 * kPeriod_s, 0.01);
  clock.add(next_ns);
  clock.add(nanoseconds(kPeriod_s * 12.0));
  EXPECT_EQ(clock.timeOf(nanoseconds(kPeriod_s * 13.0)), nanoseconds(kPeriod_s * 13.0));
}

TEST(FrameClock, FollowsAnotherRate) {
  std::vector<double> stamps_s;
  for (int i = 0; i < 20; ++i) stamps_s.push_back(0.2 * i);
  for (int i = 1; i < 60; ++i) stamps_s.push_back(0.2 * 19 + i / 30.0);
  const std::vector<double> found_s = intervals(stamps_s);
  constexpr std::size_t kChange = 19;
  constexpr std::size_t kLast = kChange + 25;
  for (std::size_t i = kChange; i < kLast; ++i) EXPECT_LT(found_s[i], 0.101) << i;
  for (std::size_t i = kLast; i < found_s.size(); ++i) EXPECT_NEAR(found_s[i], 1 / 30.0, 1e-8) << i;
}

/// Stamps that are late in turns cost nothing in all.
TEST(FrameClock, KeepsPaceWithTheStamps) {
  FrameClock clock;
  for (int i = 0; i < 1000; ++i) {
    const double late_s = i % 7 == 6 ? 0.9 * kPeriod_s : 0.0;
    const std::int64_t stamp_ns = nanoseconds(kPeriod_s * i + late_s);
    EXPECT_LT(toSeconds(clock.timeOf(stamp_ns) - stamp_ns), 0.5 * kPeriod_s) << i;
    clock.add(stamp_ns);
  }
}

}  // namespace
}  // namespace point_line_odometry
