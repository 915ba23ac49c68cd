#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "point_line_odometry/frame_result.h"

namespace point_line_odometry {

/// How many matched points agree with the motion near the rim of the mask, and elsewhere. If a mask
/// is too small, what it is to hide looks out from behind it, at rest or with a motion of its own.
class RimAgreement {
 public:
  /// Width of the rim / width of the image, from the masked pixels on.
  static constexpr double kRim = 0.05;

  struct Share {
    double points = 0.0;  ///< of the latest frames
    double inliers = 0.0;

    double agreeing() const { return points > 0.0 ? inliers / points : 0.0; }
  };

  /// \param left_mask of the image of the result's left pixels; empty: nothing is masked.
  void add(const FrameResult& result, const cv::Mat& left_mask);

  const Share& near() const { return near_; }
  const Share& elsewhere() const { return elsewhere_; }

  /// Whether clearly fewer agree near the rim; nothing before there are enough points.
  std::optional<bool> isWorseNearRim() const;

 private:
  void takeMask(const cv::Mat& left_mask);

  cv::Mat mask_;  // the last one
  cv::Mat rim_;   // 255 near it
  Share near_;
  Share elsewhere_;
};

}  // namespace point_line_odometry
