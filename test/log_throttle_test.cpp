#include "ros/log_throttle.h"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace point_line_odometry {
namespace {

TEST(LogThrottle, LetsEachKindThroughOnceInAPeriod) {
  LogThrottle throttle;
  EXPECT_TRUE(throttle.passes("lost"));
  EXPECT_TRUE(throttle.passes("late"));
  EXPECT_FALSE(throttle.passes("lost"));
  EXPECT_FALSE(throttle.passes("late"));
  EXPECT_TRUE(LogThrottle().passes("lost")) << "of another nodelet";
}

/// No clock of ROS is started here: of simulated time, none would pass without /clock.
TEST(LogThrottle, GoesByRealTime) {
  LogThrottle throttle;
  EXPECT_TRUE(throttle.passes("lost", 0.05));
  EXPECT_FALSE(throttle.passes("lost", 5.0));
  std::this_thread::sleep_for(std::chrono::milliseconds(60));
  EXPECT_TRUE(throttle.passes("lost", 0.05));
}

}  // namespace
}  // namespace point_line_odometry
