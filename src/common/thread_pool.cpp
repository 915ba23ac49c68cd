#include "common/thread_pool.h"

#include <chrono>

namespace point_line_odometry {
namespace {

// A thread that sleeps takes about this time to wake up, as long as a short task takes: one that
// waits stays awake for it.
constexpr std::chrono::microseconds kWakeUp{30};

void awaitBriefly(const std::atomic<bool>& condition) {
  const auto end = std::chrono::steady_clock::now() + kWakeUp;
  while (!condition && std::chrono::steady_clock::now() < end) std::this_thread::yield();
}

}  // namespace

ThreadPool::ThreadPool(int num_threads) {
  try {
    for (int i = 1; i < num_threads; ++i) workers_.emplace_back([this] { work(); });
  } catch (...) {
    join();
    throw;
  }
}

ThreadPool::~ThreadPool() { join(); }

void ThreadPool::join() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
    any_to_begin_ = true;
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
  any_to_begin_ = count > 1;
  all_ended_ = count == 0;
  if (count > 1) begun_.notify_all();
  runTasks(&lock);
  lock.unlock();
  awaitBriefly(all_ended_);
  lock.lock();
  ended_.wait(lock, [this] { return unfinished_ == 0; });
  task_ = nullptr;
  if (error_) std::rethrow_exception(error_);
}

void ThreadPool::runParts(
    std::size_t size,
    const std::function<void(int part, std::size_t begin, std::size_t end)>& task) {
  const auto parts = static_cast<std::size_t>(numParts());
  run(numParts(), [&](int part) {
    const auto k = static_cast<std::size_t>(part);
    task(part, size * k / parts, size * (k + 1) / parts);
  });
}

/// Takes tasks until none is left to begin. The lock is held on entry and exit, and not while a
/// task runs.
void ThreadPool::runTasks(std::unique_lock<std::mutex>* lock) {
  while (next_ < count_) {
    const int index = next_++;
    if (next_ == count_) any_to_begin_ = false;
    lock->unlock();
    std::exception_ptr error;
    try {
      (*task_)(index);
    } catch (...) {
      error = std::current_exception();
    }
    lock->lock();
    if (error && !error_) error_ = error;
    if (--unfinished_ > 0) continue;
    all_ended_ = true;
    ended_.notify_all();
  }
}

void ThreadPool::work() {
  std::unique_lock<std::mutex> lock(mutex_);
  for (;;) {
    begun_.wait(lock, [this] { return stop_ || next_ < count_; });
    if (stop_) return;
    runTasks(&lock);
    lock.unlock();
    awaitBriefly(any_to_begin_);
    lock.lock();
  }
}

}  // namespace point_line_odometry
