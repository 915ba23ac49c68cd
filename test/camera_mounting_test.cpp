/// Where the camera sits on the robot, by the frame_id of its images.

#include "ros/camera_mounting.h"

#include <gtest/gtest.h>

#include <map>
#include <stdexcept>
#include <string>

#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

/// A mounting with frames that tf knows, by their x.
class CameraMountingTest : public ::testing::Test {
 protected:
  double x(const std::string& frame_id) {
    mounting_.prepare(frame_id);
    return mounting_.take(frame_id).translation().x();
  }

  std::map<std::string, double> known_{{"left", 1.0}, {"other", 2.0}};
  int lookups_ = 0;
  CameraMounting mounting_{[this](const std::string& camera) {
    ++lookups_;
    if (known_.count(camera) == 0) throw std::runtime_error("tf does not know " + camera);
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation().x() = known_.at(camera);
    return T;
  }};
};

TEST_F(CameraMountingTest, IsLookedUpOnce) {
  for (int k = 0; k < 5; ++k) EXPECT_EQ(x(k % 2 == 0 ? "left" : "/left"), 1.0);
  EXPECT_EQ(lookups_, 1);
}

TEST_F(CameraMountingTest, WaitsForTheFirstFrame) {
  EXPECT_THROW(mounting_.prepare("unknown"), std::runtime_error);
  known_["unknown"] = 3.0;
  EXPECT_EQ(x("unknown"), 3.0);
}

TEST_F(CameraMountingTest, AnotherNameInAFewFramesIsRejected) {
  x("left");
  for (const char* other : {"other", "unknown", "", "/", "//left", "left ", "a\nb"}) {
    for (int k = 0; k < 2; ++k) EXPECT_THROW(x(other), MessageError) << other;
    EXPECT_EQ(x("left"), 1.0) << other;
  }
  EXPECT_EQ(lookups_, 1) << "and nothing has waited for tf";
}

TEST_F(CameraMountingTest, AnotherNameIsTakenWhenItStays) {
  x("left");
  EXPECT_THROW(x("other"), MessageError);
  EXPECT_THROW(x("other"), MessageError);
  EXPECT_EQ(x("other"), 2.0);
  EXPECT_EQ(x("other"), 2.0);
  EXPECT_THROW(x("left"), MessageError);
}

TEST_F(CameraMountingTest, WaitsForANameThatStays) {
  x("left");
  for (int k = 0; k < 2; ++k) EXPECT_THROW(x("unknown"), MessageError);
  EXPECT_THROW(mounting_.prepare("unknown"), std::runtime_error);
  EXPECT_EQ(x("left"), 1.0) << "it can come back even then";
  for (int k = 0; k < 2; ++k) EXPECT_THROW(x("unknown"), MessageError);
}

TEST_F(CameraMountingTest, TheErrorNamesBoth) {
  x("left");
  try {
    x("other");
    FAIL();
  } catch (const MessageError& error) {
    EXPECT_EQ(std::string(error.what()),
              "left image: frame_id is 'other' instead of 'left'; it is taken once 3 frames in a "
              "row have it");
  }
}

}  // namespace
}  // namespace point_line_odometry
