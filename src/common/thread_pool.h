#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace point_line_odometry {

/// A fixed set of threads that run independent tasks. The thread that runs a task must not matter:
/// each task writes to memory of its own.
class ThreadPool {
 public:
  /// \param num_threads at least 1; the thread that calls run() is one of them. Throws
  /// std::system_error if the system has no more.
  explicit ThreadPool(int num_threads);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int numThreads() const { return static_cast<int>(workers_.size()) + 1; }

  /// Parts into which runParts() divides its indices: some for each thread, as a thread may begin
  /// late, and parts of equal length take different times.
  int numParts() const { return workers_.empty() ? 1 : kPartsPerThread * numThreads(); }

  /// Calls task(0) ... task(count - 1), begun in this order, and returns when all have ended.
  /// Rethrows the first exception of a task, after all have ended. Not to be called from a task,
  /// nor from two threads at once.
  void run(int count, const std::function<void(int)>& task);

  /// Divides the indices 0 ... size - 1 into numParts() parts of nearly the same length, in order,
  /// and calls task(part, begin, end) for each like run().
  void runParts(std::size_t size,
                const std::function<void(int part, std::size_t begin, std::size_t end)>& task);

 private:
  void work();
  void join();
  void runTasks(std::unique_lock<std::mutex>* lock);

  static constexpr int kPartsPerThread = 4;

  std::vector<std::thread> workers_;
  std::mutex mutex_;
  std::condition_variable begun_;
  std::condition_variable ended_;
  // Written with mutex_ held, read without it by threads that are about to wait.
  std::atomic<bool> any_to_begin_{false};
  std::atomic<bool> all_ended_{true};
  // All guarded by mutex_.
  const std::function<void(int)>* task_ = nullptr;
  int next_ = 0;
  int count_ = 0;
  int unfinished_ = 0;
  std::exception_ptr error_;
  bool stop_ = false;
};

/// Calls both functions, at once if there are threads.
template <typename First, typename Second>
void runBoth(ThreadPool* threads, const First& first, const Second& second) {
  if (threads == nullptr) {
    first();
    second();
  } else {
    threads->run(2, [&](int task) { task == 0 ? first() : second(); });
  }
}

/// As ThreadPool::numParts(); without threads one.
inline int numParts(const ThreadPool* threads) {
  return threads == nullptr ? 1 : threads->numParts();
}

/// As ThreadPool::runParts(); without threads in one part.
template <typename Task>
void runParts(ThreadPool* threads, std::size_t size, const Task& task) {
  if (threads == nullptr) {
    task(0, 0, size);
  } else {
    threads->runParts(size, task);
  }
}

}  // namespace point_line_odometry
