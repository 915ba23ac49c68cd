#pragma once

#include <atomic>
#include <cstddef>
#include <new>
#include <opencv2/core.hpp>

namespace point_line_odometry {

/// Memory for images that runs out: while this lives, all allocations of the process after the
/// first `last` ones throw.
class FailingAllocator : public cv::MatAllocator {
 public:
  explicit FailingAllocator(int last) : left_(last) { cv::Mat::setDefaultAllocator(this); }
  ~FailingAllocator() override { cv::Mat::setDefaultAllocator(cv::Mat::getStdAllocator()); }

  bool hasFailed() const { return left_ < 0; }

  cv::UMatData* allocate(int dims, const int* sizes, int type, void* data, std::size_t* step,
                         cv::AccessFlag flags, cv::UMatUsageFlags usage) const override {
    if (--left_ < 0) throw std::bad_alloc();
    return cv::Mat::getStdAllocator()->allocate(dims, sizes, type, data, step, flags, usage);
  }
  bool allocate(cv::UMatData* data, cv::AccessFlag flags, cv::UMatUsageFlags usage) const override {
    return cv::Mat::getStdAllocator()->allocate(data, flags, usage);
  }
  void deallocate(cv::UMatData* data) const override {
    cv::Mat::getStdAllocator()->deallocate(data);
  }

 private:
  mutable std::atomic<int> left_;
};

}  // namespace point_line_odometry
