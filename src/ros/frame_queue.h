#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <utility>

namespace point_line_odometry {

/// Bounded queue between one producer that never waits and one consumer that does: a full queue
/// drops its oldest item, so that what is processed is never older than the queue is long.
/// Thread-safe.
template <typename Item>
class FrameQueue {
 public:
  explicit FrameQueue(std::size_t capacity) : capacity_(capacity) {}

  /// Adds an item. Returns false if the oldest one had to be dropped for it.
  bool push(Item item) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const bool full = items_.size() >= capacity_;
    if (full) items_.pop_front();
    items_.push_back(std::move(item));
    changed_.notify_one();
    return !full;
  }

  /// Waits for an item for which `ready` is true (asked again every `retry` for the oldest item)
  /// and takes it out. Returns nothing once the queue is stopped.
  std::optional<Item> popWhen(const std::function<bool(const Item&)>& ready,
                              std::chrono::milliseconds retry) {
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] { return stopped_ || !items_.empty(); });
      if (stopped_) return std::nullopt;
      if (ready(items_.front())) break;
      changed_.wait_for(lock, retry, [this] { return stopped_; });
      if (stopped_) return std::nullopt;
    }
    std::optional<Item> item(std::move(items_.front()));
    items_.pop_front();
    return item;
  }

  /// Drops everything that waits.
  void clear() {
    const std::lock_guard<std::mutex> lock(mutex_);
    items_.clear();
  }

  /// Ends popWhen(), now and later.
  void stop() {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopped_ = true;
    changed_.notify_all();
  }

 private:
  const std::size_t capacity_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Item> items_;
  bool stopped_ = false;
};

}  // namespace point_line_odometry
