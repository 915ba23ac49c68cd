#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <utility>

namespace point_line_odometry {

/// Bounded queue between one producer, which never waits, and one consumer, which does: a full
/// queue drops its oldest item, which bounds the latency. Thread-safe.
template <typename Item>
class FrameQueue {
 public:
  explicit FrameQueue(std::size_t capacity) : capacity_(capacity) {}

  /// Adds an item. Returns false if the oldest one had to be dropped for it.
  bool push(Item item) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const bool full = items_.size() >= capacity_;
    if (full) removeOldest();
    items_.push_back(std::move(item));
    changed_.notify_one();
    return !full;
  }

  /// Waits until `ready` is true of the oldest item (called again every `retry`) and removes it.
  /// Returns nothing once the queue is stopped. push() never waits for `ready`.
  std::optional<Item> popWhen(const std::function<bool(const Item&)>& ready,
                              std::chrono::milliseconds retry) {
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] { return stopped_ || !items_.empty(); });
      if (stopped_) return std::nullopt;
      const Item oldest = items_.front();
      const std::uint64_t number = num_removed_;
      lock.unlock();
      const bool is_ready = ready(oldest);
      lock.lock();
      if (is_ready && !stopped_ && number == num_removed_) {
        removeOldest();
        return oldest;
      }
      if (!is_ready) changed_.wait_for(lock, retry, [this] { return stopped_; });
    }
  }

  /// Drops all items.
  void clear() {
    const std::lock_guard<std::mutex> lock(mutex_);
    num_removed_ += items_.size();
    items_.clear();
  }

  /// Ends popWhen(), now and later.
  void stop() {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopped_ = true;
    changed_.notify_all();
  }

 private:
  void removeOldest() {
    items_.pop_front();
    ++num_removed_;
  }

  const std::size_t capacity_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Item> items_;
  std::uint64_t num_removed_ = 0;  // since the start; if it changed, so did the oldest item
  bool stopped_ = false;
};

}  // namespace point_line_odometry
