
#include "common/thread_pool.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <set>
#include <stdexcept>
#include <system_error>

namespace point_line_odometry {
namespace {

TEST(ThreadPool, RunsEachTaskOnce) {
  for (const int num_threads : {1, 2, 5}) {
    ThreadPool threads(num_threads);
    EXPECT_EQ(threads.numThreads(), num_threads);
    for (const int count : {0, 1, 3, 100}) {
      std::vector<std::atomic<int>> runs(static_cast<std::size_t>(count));
      threads.run(count, [&](int task) { ++runs[static_cast<std::size_t>(task)]; });
      for (const std::atomic<int>& n : runs) EXPECT_EQ(n, 1);
    }
  }
}

TEST(ThreadPool, OneThreadIsTheCaller) {
  ThreadPool threads(1);
  const std::thread::id caller = std::this_thread::get_id();
  threads.run(4, [&](int) { EXPECT_EQ(std::this_thread::get_id(), caller); });
}

TEST(ThreadPool, ThreadsAreReused) {
  ThreadPool threads(3);
  std::mutex mutex;
  std::set<std::thread::id> ids;
  for (int round = 0; round < 200; ++round) {
    threads.run(8, [&](int) {
      const std::lock_guard<std::mutex> lock(mutex);
      ids.insert(std::this_thread::get_id());
    });
  }
  EXPECT_LE(ids.size(), 3U);
}

TEST(ThreadPool, TasksRunInParallel) {
  ThreadPool threads(2);
  std::atomic<int> begun{0};
  threads.run(2, [&](int) {
    ++begun;
    while (begun < 2) std::this_thread::yield();  // for ever if one waited for the other
  });
  EXPECT_EQ(begun, 2);
}

TEST(ThreadPool, PartsCoverAllInOrder) {
  for (const int num_threads : {1, 2, 3, 7}) {
    ThreadPool threads(num_threads);
    for (const std::size_t size : {0U, 1U, 2U, 50U, 1001U}) {
      std::vector<std::pair<std::size_t, std::size_t>> parts(
          static_cast<std::size_t>(threads.numParts()));
      threads.runParts(size, [&](int part, std::size_t begin, std::size_t end) {
        parts[static_cast<std::size_t>(part)] = {begin, end};
      });
      std::size_t expected = 0;
      for (const auto& part : parts) {
        EXPECT_EQ(part.first, expected);
        EXPECT_LE(part.second - part.first, size / parts.size() + 1);
        expected = part.second;
      }
      EXPECT_EQ(expected, size);
    }
  }
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(__clang__)
/// In a process of its own, which would wait for ever.
TEST(ThreadPool, ThrowsIfThereAreNoMoreThreads) {
  EXPECT_EXIT(
      {
        alarm(20);
        rlimit limit{};
        limit.rlim_cur = limit.rlim_max = 400U << 20U;  // of memory: each has a stack of 8 MB
        setrlimit(RLIMIT_AS, &limit);
        try {
          const ThreadPool threads(400);
        } catch (const std::system_error&) {
          std::_Exit(7);
        }
      },
      ::testing::ExitedWithCode(7), "");
}
#endif

TEST(ThreadPool, RethrowsAndContinues) {
  ThreadPool threads(2);
  std::atomic<int> runs{0};
  const auto failing = [&](int task) {
    ++runs;
    if (task == 3) throw std::runtime_error("task 3");
  };
  EXPECT_THROW(threads.run(10, failing), std::runtime_error);
  EXPECT_EQ(runs, 10);
  threads.run(10, [&](int) { ++runs; });
  EXPECT_EQ(runs, 20);
}

}  // namespace
}  // namespace point_line_odometry
