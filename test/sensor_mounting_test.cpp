/// The pose of a sensor in the base, by the frame_id of its messages.

#include "ros/sensor_mounting.h"

#include <gtest/gtest.h>

#include <map>
#include <stdexcept>
#include <string>

#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

/// A mounting with frames that tf knows, by their x.
class SensorMountingTest : public ::testing::Test {
 protected:
  double x(const std::string& frame_id) {
    mounting_.prepare(frame_id);
    return mounting_.take(frame_id).translation().x();
  }

  std::map<std::string, double> known_{{"left", 1.0}, {"other", 2.0}};
  int lookups_ = 0;
  SensorMounting mounting_{"left image", [this](const std::string& camera) {
                             ++lookups_;
                             if (known_.count(camera) == 0)
                               throw std::runtime_error("tf does not know " + camera);
                             Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
                             T.translation().x() = known_.at(camera);
                             return T;
                           }};
};

TEST_F(SensorMountingTest, IsLookedUpOnce) {
  for (int k = 0; k < 5; ++k) EXPECT_EQ(x(k % 2 == 0 ? "left" : "/left"), 1.0);
  EXPECT_EQ(lookups_, 1);
}

TEST_F(SensorMountingTest, WaitsForTheFirstFrame) {
  EXPECT_THROW(mounting_.prepare("unknown"), std::runtime_error);
  known_["unknown"] = 3.0;
  EXPECT_EQ(x("unknown"), 3.0);
}

TEST_F(SensorMountingTest, AnotherNameInAFewFramesIsRejected) {
  x("left");
  for (const char* other : {"other", "unknown", "", "/", "//left", "left ", "a\nb"}) {
    for (int k = 0; k < 2; ++k) EXPECT_THROW(x(other), MessageError) << other;
    EXPECT_EQ(x("left"), 1.0) << other;
  }
  EXPECT_EQ(lookups_, 1) << "and did not wait for tf";
}

TEST_F(SensorMountingTest, AnotherNameIsAcceptedWhenItStays) {
  x("left");
  EXPECT_THROW(x("other"), MessageError);
  EXPECT_THROW(x("other"), MessageError);
  EXPECT_EQ(x("other"), 2.0);
  EXPECT_EQ(x("other"), 2.0);
  EXPECT_THROW(x("left"), MessageError);
}

TEST_F(SensorMountingTest, WaitsForANameThatStays) {
  x("left");
  for (int k = 0; k < 2; ++k) EXPECT_THROW(x("unknown"), MessageError);
  EXPECT_THROW(mounting_.prepare("unknown"), std::runtime_error);
  EXPECT_EQ(x("left"), 1.0) << "the first frame is accepted again";
  for (int k = 0; k < 2; ++k) EXPECT_THROW(x("unknown"), MessageError);
}

TEST_F(SensorMountingTest, TheErrorNamesBoth) {
  x("left");
  try {
    x("other");
    FAIL();
  } catch (const MessageError& error) {
    EXPECT_EQ(
        std::string(error.what()),
        "left image: frame_id is 'other' instead of 'left'; it is accepted once 3 messages in a "
        "row have it");
  }
}

}  // namespace
}  // namespace point_line_odometry
