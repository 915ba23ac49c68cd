/// The least time between frames, by stamps as drivers give them.

#include "motion/frame_intervals.h"

#include <gtest/gtest.h>

#include <initializer_list>
#include <vector>

namespace point_line_odometry {
namespace {

FrameIntervals after(const std::vector<double>& intervals_s) {
  FrameIntervals intervals;
  for (const double interval_s : intervals_s) intervals.add(interval_s);
  return intervals;
}

/// Time between two frames with the same stamp.
double least(const FrameIntervals& intervals) { return intervals.between(0, 0); }

TEST(FrameIntervals, KnowNothingOfOne) {
  EXPECT_EQ(least(FrameIntervals()), 0.0);
  EXPECT_EQ(least(after({0.1})), 0.0) << "it may be a gap";
  EXPECT_DOUBLE_EQ(least(after({0.1, 0.1})), 0.05);
}

TEST(FrameIntervals, LeaveGapsOut) {
  EXPECT_DOUBLE_EQ(least(after({0.9, 0.1})), 0.05);
  EXPECT_DOUBLE_EQ(least(after({60.0, 0.1, 0.1})), 0.05);
  EXPECT_LT(least(after({0.9, 0.033, 0.033, 0.9, 0.033, 0.033, 0.033, 0.033})), 0.03);
  EXPECT_DOUBLE_EQ(least(after({0.1, 0.1, 0.1, 0.9, 0.1, 0.1, 3600.0})), 0.05);
}

/// Frames that are there are hardly ever nearer than this.
TEST(FrameIntervals, AllowForDroppedFrames) {
  EXPECT_LE(least(after({0.1, 0.2, 0.1, 0.3, 0.2, 0.1, 0.2, 0.3})), 0.1);
  EXPECT_LE(least(after({0.3, 0.2, 0.1, 0.4, 0.3, 0.1, 0.2, 0.3})), 0.11);
}

TEST(FrameIntervals, SeparateFramesThatArriveTogether) {
  for (const auto& intervals_s : {std::vector<double>{0.001, 0.199, 0.001, 0.199},
                                  {0.1, 0.1, 0.1, 0.1, 0.001, 0.199, 0.1, 0.1},
                                  {0.1, 0.19, 0.01, 0.1, 0.1, 0.1, 0.1, 0.1},
                                  {0.1, 0.1, 0.1, 0.1, 0.397, 0.001, 0.001, 0.001}}) {
    EXPECT_GT(least(after(intervals_s)), 0.025);
    EXPECT_LT(least(after(intervals_s)), 0.055);
  }
}

TEST(FrameIntervals, FollowAnotherRateWithinEightFrames) {
  std::vector<double> intervals_s(20, 0.2);
  for (int i = 0; i < 8; ++i) intervals_s.push_back(1.0 / 30.0);
  EXPECT_NEAR(least(after(intervals_s)), 0.5 / 30.0, 1e-9);
}

TEST(FrameIntervals, AreNoneOfASlowCamera) { EXPECT_EQ(least(after({2.0, 2.0, 2.0})), 0.0); }

}  // namespace
}  // namespace point_line_odometry
