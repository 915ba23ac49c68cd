#include "point_line_odometry/thread_pool.h"

namespace point_line_odometry {

ThreadPool::ThreadPool(int num_threads) {
  for (int i = 1; i < num_threads; ++i) workers_.emplace_back([this] { work(); });
}

ThreadPool::~ThreadPool() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  begun_.notify_all();
  for (std::thread& worker : workers_) worker.join();
}

void ThreadPool::run(int count, const std::function<void(int)>& task) {
  std::unique_lock<std::mutex> lock(mutex_);
  task_ = &task;
  next_ = 0;
  count_ = count;
  unfinished_ = count;
  error_ = nullptr;
  if (count > 1) begun_.notify_all();
  runTasks(&lock);
  ended_.wait(lock, [this] { return unfinished_ == 0; });
  task_ = nullptr;
  if (error_) std::rethrow_exception(error_);
}

void ThreadPool::runParts(
    std::size_t size,
    const std::function<void(int part, std::size_t begin, std::size_t end)>& task) {
  const auto parts = static_cast<std::size_t>(numThreads());
  run(numThreads(), [&](int part) {
    const auto k = static_cast<std::size_t>(part);
    task(part, size * k / parts, size * (k + 1) / parts);
  });
}

/// Takes tasks until none is left to begin. The lock is held on entry and exit, and not while a
/// task runs.
void ThreadPool::runTasks(std::unique_lock<std::mutex>* lock) {
  while (next_ < count_) {
    const int index = next_++;
    lock->unlock();
    std::exception_ptr error;
    try {
      (*task_)(index);
    } catch (...) {
      error = std::current_exception();
    }
    lock->lock();
    if (error && !error_) error_ = error;
    if (--unfinished_ == 0) ended_.notify_all();
  }
}

void ThreadPool::work() {
  std::unique_lock<std::mutex> lock(mutex_);
  for (;;) {
    begun_.wait(lock, [this] { return stop_ || next_ < count_; });
    if (stop_) return;
    runTasks(&lock);
  }
}

}  // namespace point_line_odometry
