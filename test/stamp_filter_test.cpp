/// Which messages of a topic pass, by their stamps.

#include "ros/stamp_filter.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace point_line_odometry {
namespace {

constexpr std::uint32_t kEndOfTime = 4294967295U;

/// The messages of a topic in order of arrival: which have passed and which were rejected.
struct Topic {
  StampFilter filter;
  ros::Time now;
  std::vector<int> passed;
  std::vector<StampFault> faults;
  std::vector<std::string> texts;
  std::vector<double> jumps_s;
  int count = 0;

  void add(const ros::Time& stamp) {
    const auto decision = filter.add(stamp, now, [this, k = count] { passed.push_back(k); });
    ++count;
    for (const auto& deliver : decision.passed) deliver();
    for (const auto& rejection : decision.rejected) {
      faults.push_back(rejection.fault);
      texts.push_back(rejection.text());
    }
    if (decision.jump_s) jumps_s.push_back(*decision.jump_s);
  }

  void addRow(double begin_s, int number, double period_s = 0.05) {
    for (int k = 0; k < number; ++k) add(ros::Time(begin_s + k * period_s));
  }
};

std::vector<int> upTo(int end, const std::vector<int>& without = {}) {
  std::vector<int> numbers;
  for (int k = 0; k < end; ++k) {
    if (std::find(without.begin(), without.end(), k) == without.end()) numbers.push_back(k);
  }
  return numbers;
}

TEST(StampFilter, PassesTheMessagesOfACamera) {
  Topic topic;
  topic.addRow(1000.0, 5);
  topic.addRow(1000.9, 5);       // a gap
  topic.add(ros::Time(1000.5));  // late
  EXPECT_EQ(topic.passed, upTo(11));
  EXPECT_TRUE(topic.faults.empty());
  EXPECT_TRUE(topic.jumps_s.empty());
}

/// As a deserialised message may have it: not normalised.
ros::Time rawTime(std::uint32_t sec, std::uint32_t nsec) {
  ros::Time time;
  time.sec = sec;
  time.nsec = nsec;
  return time;
}

TEST(StampFilter, RejectsInvalidTimesHoweverManyThereAre) {
  for (const ros::Time& wild :
       {ros::Time(), rawTime(kEndOfTime, 0), rawTime(kEndOfTime, 999999999),
        rawTime(kEndOfTime, kEndOfTime), rawTime(1000, 1000000000), rawTime(kEndOfTime - 10, 0)}) {
    Topic topic;
    for (int k = 0; k < 6; ++k) topic.add(wild);
    EXPECT_TRUE(topic.passed.empty()) << wild.sec;
    EXPECT_EQ(topic.faults.size(), 6U) << wild.sec;
    topic.addRow(1000.0, 2);
    EXPECT_EQ(topic.passed, (std::vector<int>{6, 7})) << wild.sec;
  }
}

TEST(StampFilter, NamesTheStampAndItsFault) {
  Topic topic;
  topic.add(ros::Time());
  topic.add(rawTime(kEndOfTime, 5));
  topic.add(ros::Time(1000.0));
  topic.add(ros::Time(3.25));
  topic.add(ros::Time(1000.05));
  EXPECT_EQ(topic.texts,
            (std::vector<std::string>{"stamp 0.000000000 is no valid time",
                                      "stamp 4294967295.000000005 is out of the valid range",
                                      "stamp 3.250000000 is far from those before and after it"}));
}

TEST(StampFilter, RejectsAFewMessagesFarFromTheOthers) {
  for (const double wild_s : {0.5, 400.0, 998.0, 1001.5, 4600.0, 2e9, 4.2e9}) {
    for (const int number : {1, 2}) {
      Topic topic;
      topic.addRow(1000.0, 3);
      topic.addRow(wild_s, number);
      topic.addRow(1000.15, 3);
      const std::vector<int> wild = number == 1 ? std::vector<int>{3} : std::vector<int>{3, 4};
      EXPECT_EQ(topic.passed, upTo(topic.count, wild)) << wild_s;
      EXPECT_EQ(topic.faults, std::vector<StampFault>(wild.size(), StampFault::kUnconfirmedJump))
          << wild_s;
      EXPECT_TRUE(topic.jumps_s.empty()) << wild_s;
    }
  }
}

TEST(StampFilter, RejectsMessagesThatDoNotConfirmEachOther) {
  Topic topic;
  topic.addRow(1000.0, 3);
  for (const double wild_s : {2000.0, 2000.0, 2000.0, 3000.0, 2500.0, 2499.0, 9000.0}) {
    topic.add(ros::Time(wild_s));
  }
  topic.addRow(1000.15, 3);
  EXPECT_EQ(topic.passed, (std::vector<int>{0, 1, 2, 10, 11, 12}));
  EXPECT_EQ(topic.faults.size(), 7U);
}

TEST(StampFilter, EverySecondMessageMayBeWild) {
  Topic topic;
  for (int k = 0; k < 10; ++k) {
    topic.add(ros::Time(1000.0 + 0.1 * k));
    topic.add(ros::Time(5000.0 + 0.1 * k));
  }
  EXPECT_EQ(topic.passed.size(), 10U);
  EXPECT_TRUE(topic.jumps_s.empty());
}

/// No message after a true jump is lost.
TEST(StampFilter, FollowsAJumpThatTheNextMessagesConfirm) {
  for (const double to_s : {2.0, 990.0, 1010.0, 40000.0, 4.2e9}) {
    Topic topic;
    topic.addRow(1000.0, 4);
    topic.addRow(to_s, 2);
    EXPECT_EQ(topic.passed, upTo(4)) << to_s;
    topic.addRow(to_s + 0.1, 3);
    EXPECT_EQ(topic.passed, upTo(9)) << to_s;
    EXPECT_TRUE(topic.faults.empty()) << to_s;
    ASSERT_EQ(topic.jumps_s.size(), 1U) << to_s;
    EXPECT_NEAR(topic.jumps_s[0], to_s - 1000.15, 1e-6) << to_s;
  }
}

TEST(StampFilter, PassesASlowCameraThatMissesFrames) {
  Topic topic;
  topic.addRow(1000.0, 6, 2.0);
  topic.add(ros::Time(1014.0));
  EXPECT_EQ(topic.passed, upTo(7));
  topic.add(ros::Time(1012.0));
  EXPECT_EQ(topic.passed, upTo(7)) << "for the odometry the clock would have jumped back";
  topic.add(ros::Time(1016.0));
  EXPECT_EQ(topic.passed, upTo(9, {7}));
}

TEST(StampFilter, AFirstStampInTheFutureMustBeConfirmed) {
  Topic topic;
  topic.now = ros::Time(1010.0);
  topic.add(ros::Time(2e9));
  topic.addRow(1000.0, 2);
  EXPECT_EQ(topic.passed, (std::vector<int>{1, 2}));
  Topic ahead;  // all of them
  ahead.now = ros::Time(1010.0);
  ahead.addRow(2e9, 4);
  EXPECT_EQ(ahead.passed, upTo(4));
  EXPECT_EQ(ahead.jumps_s, std::vector<double>{0.0});
}

}  // namespace
}  // namespace point_line_odometry
