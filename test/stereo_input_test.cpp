/// Synchronisation of the four topics, and messages that are rejected for their stamps.

#include "ros/stereo_input.h"

#include <gtest/gtest.h>

#include <boost/make_shared.hpp>
#include <string>
#include <vector>

namespace point_line_odometry {
namespace {

constexpr double kPeriod_s = 0.05;
constexpr std::uint32_t kEndOfTime = 4294967295U;

/// A stereo camera whose messages have stamps chosen by the test.
class StereoInputTest : public ::testing::TestWithParam<bool> {
 protected:
  StereoInputTest() {
    ros::Time::init();
    NodeParameters parameters;
    parameters.approximate_sync = GetParam();
    input_.emplace(
        parameters, StereoInput::TopicNames{"left", "right", "left_info", "right_info"},
        [this](const StereoMessages& set) { sets_s_.push_back(set.left->header.stamp.toSec()); },
        [this](const std::string& text) { rejected_.push_back(text); });
  }

  void add(std::size_t topic, const ros::Time& stamp) {
    arrival_s_ += kPeriod_s / kNumStereoTopics;
    if (topic < kLeftInfo) {
      const auto image = boost::make_shared<sensor_msgs::Image>();
      image->header.stamp = stamp;
      input_->addImage(static_cast<StereoTopic>(topic), image, arrival_s_);
    } else {
      const auto info = boost::make_shared<sensor_msgs::CameraInfo>();
      info->header.stamp = stamp;
      input_->addInfo(static_cast<StereoTopic>(topic), info, arrival_s_);
    }
  }

  void addFrame(const std::array<ros::Time, kNumStereoTopics>& stamps) {
    for (std::size_t topic = 0; topic < kNumStereoTopics; ++topic) add(topic, stamps[topic]);
  }

  void addFrame(const ros::Time& stamp) { addFrame({stamp, stamp, stamp, stamp}); }

  void addFrames(double begin_s, int number) {
    for (int k = 0; k < number; ++k) addFrame(ros::Time(begin_s + k * kPeriod_s));
  }

  /// These stamps in turn, forwards and backwards.
  static std::vector<ros::Time> wildStamps() {
    return {ros::Time(),
            ros::Time(kEndOfTime, 0),
            ros::Time(kEndOfTime, 999999999),
            ros::Time(3000000000U, 0),
            ros::Time(4600.0),
            ros::Time(900.0),
            ros::Time(0, 1)};
  }

  std::optional<StereoInput> input_;
  std::vector<double> sets_s_;
  std::vector<std::string> rejected_;
  double arrival_s_ = 0.0;
};

/// Number of sets that must be complete; one may still wait for the next frame.
std::size_t finished(int frames, bool approximate) {
  return static_cast<std::size_t>(frames) - (approximate ? 1U : 0U);
}

TEST_P(StereoInputTest, AFrameWithAWildStampIsRejectedAndAllOthersPass) {
  int frames = 0;
  for (const ros::Time& wild : wildStamps()) {
    addFrames(1000.0 + frames * kPeriod_s, 4);
    frames += 4;
    addFrame(wild);
  }
  addFrames(1000.0 + frames * kPeriod_s, 4);
  frames += 4;
  ASSERT_GE(sets_s_.size(), finished(frames, GetParam()));
  for (std::size_t k = 0; k < sets_s_.size(); ++k) {
    EXPECT_NEAR(sets_s_[k], 1000.0 + static_cast<double>(k) * kPeriod_s, 1e-6);
  }
  EXPECT_EQ(rejected_.size(), 4 * wildStamps().size());
}

/// Each of the four topics alone, more often than the queue is long.
TEST_P(StereoInputTest, AMessageWithAWildStampLosesItsOwnFrameOnly) {
  int frames = 0;
  for (int round = 0; round < 4; ++round) {
    for (std::size_t topic = 0; topic < kNumStereoTopics; ++topic) {
      for (const ros::Time& wild : wildStamps()) {
        addFrames(1000.0 + frames * kPeriod_s, 2);
        frames += 2;
        const ros::Time stamp(1000.0 + frames * kPeriod_s);
        ++frames;
        std::array<ros::Time, kNumStereoTopics> stamps{stamp, stamp, stamp, stamp};
        stamps[topic] = wild;
        addFrame(stamps);
      }
    }
  }
  addFrames(1000.0 + frames * kPeriod_s, 2);
  const std::size_t wild = 4 * kNumStereoTopics * wildStamps().size();
  EXPECT_EQ(rejected_.size(), wild);
  EXPECT_GE(sets_s_.size(), finished(2 + 2 * static_cast<int>(wild), GetParam()));
  EXPECT_LE(sets_s_.size(), 2 + 2 * wild);
}

/// A robot that waited for the next frame would always be a frame late.
TEST_P(StereoInputTest, AFrameIsCompleteWhenItsLastMessageHasCome) {
  const ros::Duration later(GetParam() ? 0.004 : 0.0);
  for (std::size_t k = 0; k < 20; ++k) {
    const ros::Time left(1000.0 + static_cast<double>(k) * kPeriod_s);
    const ros::Time right = left + later;
    addFrame({left, right, left, right});
    EXPECT_EQ(sets_s_.size(), k + 1);
  }
}

TEST_P(StereoInputTest, AJumpOfTheClockLosesNoFrame) {
  for (const double to_s : {500.0, 501.0, 50000.0, 20.0, 1.6e9}) addFrames(to_s, 8);
  EXPECT_TRUE(rejected_.empty());
  const std::size_t lost_at_jumps =
      GetParam() ? 5 : 0;  // each time the last one waits for the next
  EXPECT_GE(sets_s_.size() + lost_at_jumps, 40U);
}

/// Messages of the second camera arrive late, so that its clock seems to jump later.
TEST_P(StereoInputTest, GoesOnAfterAJumpThatIsLaterOnOneTopic) {
  const auto stampOf = [](int k) { return ros::Time((k < 20 ? 1000.0 : 100.0) + k * kPeriod_s); };
  constexpr int kLate = 4;
  for (int k = 0; k < 60; ++k) {
    for (const std::size_t topic : {kLeftImage, kLeftInfo, kRightInfo}) add(topic, stampOf(k));
    if (k >= kLate) add(kRightImage, stampOf(k - kLate));
  }
  EXPECT_GE(sets_s_.size(), 40U);
  EXPECT_TRUE(rejected_.empty());
}

/// Queued messages of the other topics are lost meanwhile.
TEST_P(StereoInputTest, OneClockThatJumpsAloneComesBack) {
  addFrames(1000.0, 4);
  for (int k = 0; k < 6; ++k) {
    const ros::Time stamp(1000.2 + k * kPeriod_s);
    const ros::Time wild(3e9 + k * kPeriod_s);
    addFrame({stamp, wild, stamp, wild});
  }
  const std::size_t sets = sets_s_.size();
  addFrames(1000.5, 8);
  EXPECT_GE(sets_s_.size() - sets, finished(5, GetParam()));
}

TEST_P(StereoInputTest, ExplainsThatAllStampsAreZero) {
  for (int k = 0; k < 5; ++k) addFrame(ros::Time());
  const std::string text = input_->explainTimeout();
  EXPECT_NE(text.find("20 messages were rejected for their stamps"), std::string::npos) << text;
  EXPECT_NE(text.find("right_info: stamp 0.000000000 is no valid time"), std::string::npos) << text;
  EXPECT_TRUE(input_->facts(arrival_s_).unstamped);
  addFrames(1000.0, 2);
  EXPECT_FALSE(input_->facts(arrival_s_).unstamped) << "it is over";
}

INSTANTIATE_TEST_SUITE_P(Sync, StereoInputTest, ::testing::Bool(),
                         [](const auto& info) { return info.param ? "approximate" : "exact"; });

}  // namespace
}  // namespace point_line_odometry
