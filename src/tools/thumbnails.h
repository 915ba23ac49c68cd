#pragma once

#include <cstddef>
#include <functional>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "point_line_odometry/frame_result.h"

namespace point_line_odometry {

/// An even sample of a series of unknown length, of bounded size: every 2^k-th member.
class EvenSample {
 public:
  static constexpr std::size_t kMaxSize = 16;

  /// Takes the next member if it belongs to the sample; `make` is called only then.
  void offer(std::size_t frame, const std::function<std::string()>& make);

  struct Member {
    std::size_t frame = 0;
    std::string image;
  };
  const std::vector<Member>& members() const { return members_; }

 private:
  std::size_t count_ = 0;
  std::size_t step_ = 1;
  std::vector<Member> members_;
};

/// Small images, at most 320 px wide, of frames whose state is not OK: of the first ones after
/// frames of another state, and of the others, each an even sample over the run.
class Thumbnails {
 public:
  /// \param draw gives the image of the frame; called only if it is to be kept.
  void offer(std::size_t frame, TrackingState state, const std::function<cv::Mat()>& draw);

  /// Writes them as NNNNNN.jpg, by the index of the frame. Throws InputError if that fails.
  void write(const std::string& folder) const;

 private:
  TrackingState last_ = TrackingState::kOk;
  EvenSample first_;
  EvenSample others_;
};

}  // namespace point_line_odometry
