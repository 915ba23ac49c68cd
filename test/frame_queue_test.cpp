#include "ros/frame_queue.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <memory>
#include <optional>
#include <thread>

namespace point_line_odometry {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kRetry{1};
constexpr milliseconds kLong{5000};

bool always(const int&) { return true; }
void ignore() {}

TEST(FrameQueue, KeepsTheNewestInOrderAndReportsDrops) {
  int dropped = 0;
  FrameQueue<int> queue(3, 3, [&dropped] { ++dropped; });
  for (int i = 0; i < 10; ++i) queue.push(i);
  EXPECT_EQ(dropped, 7);
  for (int i = 7; i < 10; ++i) EXPECT_EQ(queue.popWhen(always, kRetry), i);
}

TEST(FrameQueue, HoldsNoMoreThanItsCapacity) {
  FrameQueue<std::shared_ptr<int>> queue(2, 2, ignore);
  const auto item = std::make_shared<int>(1);
  for (int i = 0; i < 100; ++i) queue.push(item);
  EXPECT_EQ(item.use_count(), 1 + 2);
  queue.clear();
  EXPECT_EQ(item.use_count(), 1);
}

TEST(FrameQueue, ConsumerWaitsForAnItem) {
  FrameQueue<int> queue(2, 2, ignore);
  auto consumer =
      std::async(std::launch::async, [&queue] { return queue.popWhen(always, kRetry); });
  EXPECT_EQ(consumer.wait_for(milliseconds(50)), std::future_status::timeout);
  queue.push(4);
  EXPECT_EQ(consumer.get(), 4);
}

TEST(FrameQueue, ItemsThatAreNotReadyWaitAndAreDroppedWhenOld) {
  FrameQueue<int> queue(2, 2, ignore);
  std::atomic<bool> ready{false};
  auto consumer = std::async(std::launch::async, [&] {
    return queue.popWhen([&ready](const int&) { return ready.load(); }, kRetry);
  });
  for (int i = 0; i < 5; ++i) queue.push(i);
  EXPECT_EQ(consumer.wait_for(milliseconds(50)), std::future_status::timeout);
  ready = true;
  EXPECT_EQ(consumer.get(), 3);
  EXPECT_EQ(queue.popWhen(always, kRetry), 4);
}

TEST(FrameQueue, KeepsFewItemsThatAreReadyAndManyThatAreNot) {
  int dropped = 0;
  FrameQueue<int> queue(2, 20, [&dropped] { ++dropped; });
  for (int i = 0; i < 10; ++i) queue.push(i);
  const auto upTo = [](int last) { return [last](const int& item) { return item <= last; }; };
  EXPECT_EQ(queue.popWhen(upTo(1), kRetry), 0) << "two are ready, eight wait for something";
  EXPECT_EQ(dropped, 0);
  EXPECT_EQ(queue.popWhen(upTo(7), kRetry), 6) << "of seven that are ready five are too many";
  EXPECT_EQ(dropped, 5);
  EXPECT_EQ(queue.popWhen(always, kRetry), 8);
  EXPECT_EQ(queue.popWhen(always, kRetry), 9);
  EXPECT_EQ(dropped, 6);
}

TEST(FrameQueue, ProducerDoesNotWaitForTheConsumersDecision) {
  FrameQueue<int> queue(2, 2, ignore);
  std::promise<void> asked;
  std::promise<void> released;
  std::atomic<int> questions{0};
  auto consumer = std::async(std::launch::async, [&] {
    return queue.popWhen(
        [&](const int&) {
          if (questions++ == 0) {
            asked.set_value();
            released.get_future().wait();
          }
          return true;
        },
        kRetry);
  });
  queue.push(0);
  asked.get_future().wait();
  auto producer = std::async(std::launch::async, [&queue] {
    for (int i = 1; i < 4; ++i) queue.push(i);
  });
  const bool went_on = producer.wait_for(kLong) == std::future_status::ready;
  released.set_value();
  EXPECT_TRUE(went_on);
  EXPECT_EQ(consumer.get(), 2)
      << "the item that `ready` was called with has been dropped meanwhile";
  EXPECT_EQ(questions, 2);
}

TEST(FrameQueue, StopEndsEveryWait) {
  for (const bool with_item : {false, true}) {
    FrameQueue<int> queue(2, 2, ignore);
    if (with_item) queue.push(1);
    auto consumer = std::async(std::launch::async, [&queue] {
      return queue.popWhen([](const int&) { return false; }, kLong * 100);
    });
    EXPECT_EQ(consumer.wait_for(milliseconds(20)), std::future_status::timeout);
    queue.stop();
    ASSERT_EQ(consumer.wait_for(kLong), std::future_status::ready);
    EXPECT_EQ(consumer.get(), std::nullopt);
    EXPECT_EQ(queue.popWhen(always, kRetry), std::nullopt);
  }
}

}  // namespace
}  // namespace point_line_odometry
