#pragma once

#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace point_line_odometry {

/// Threads that live as long as this and share out independent tasks. Which thread runs a task must
/// not matter: results are written to places of their own.
class ThreadPool {
 public:
  /// \param num_threads at least 1; the thread that calls run() is one of them.
  explicit ThreadPool(int num_threads);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int numThreads() const { return static_cast<int>(workers_.size()) + 1; }

  /// Calls task(0) ... task(count - 1), begun in this order, and returns when all have ended.
  /// Throws what the first task threw that did, after all have ended. Not to be called from a task,
  /// nor from two threads at once.
  void run(int count, const std::function<void(int)>& task);

  /// Cuts the indices 0 ... size - 1 into numThreads() parts of nearly the same length, in order,
  /// and calls task(part, begin, end) for each like run().
  void runParts(std::size_t size,
                const std::function<void(int part, std::size_t begin, std::size_t end)>& task);

 private:
  void work();
  void runTasks(std::unique_lock<std::mutex>* lock);

  std::vector<std::thread> workers_;
  std::mutex mutex_;
  std::condition_variable begun_;
  std::condition_variable ended_;
  // All guarded by mutex_.
  const std::function<void(int)>* task_ = nullptr;
  int next_ = 0;
  int count_ = 0;
  int unfinished_ = 0;
  std::exception_ptr error_;
  bool stop_ = false;
};

}  // namespace point_line_odometry
