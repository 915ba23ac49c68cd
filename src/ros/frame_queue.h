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

/// Bounded queue between one producer, which never waits, and one consumer, which does: of too many
/// items the oldest is dropped, which bounds the latency. Thread-safe.
template <typename Item>
class FrameQueue {
 public:
  using Callback = std::function<void()>;

  /// \param max_ready items that may wait for the consumer alone. \param max_all the same and those
  /// that are not ready yet. \param dropped called for each item that is dropped, by either thread.
  FrameQueue(std::size_t max_ready, std::size_t max_all, Callback dropped)
      : max_ready_(max_ready), max_all_(max_all), dropped_(std::move(dropped)) {}

  void push(Item item) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (items_.size() >= max_all_) dropOldest();
    items_.push_back(std::move(item));
    changed_.notify_one();
  }

  /// Waits until `ready` is true of the oldest item (called again every `retry`) and removes it.
  /// Returns nothing once the queue is stopped. push() never waits for `ready`. Items become ready
  /// in their order.
  std::optional<Item> popWhen(const std::function<bool(const Item&)>& ready,
                              std::chrono::milliseconds retry) {
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] { return stopped_ || !items_.empty(); });
      if (stopped_) return std::nullopt;
      const Item oldest = items_.front();
      std::optional<Item> too_many;
      if (items_.size() > max_ready_) too_many = items_[max_ready_];
      const std::uint64_t number = num_removed_;
      lock.unlock();
      const bool is_ready = ready(oldest);
      const bool is_dropped = is_ready && too_many && ready(*too_many);
      lock.lock();
      if (is_ready && !stopped_ && number == num_removed_) {
        if (is_dropped) {
          dropOldest();
          continue;
        }
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

  void dropOldest() {
    removeOldest();
    dropped_();
  }

  const std::size_t max_ready_;
  const std::size_t max_all_;
  const Callback dropped_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Item> items_;
  std::uint64_t num_removed_ = 0;  // since the start; if it changed, so did the oldest item
  bool stopped_ = false;
};

}  // namespace point_line_odometry
