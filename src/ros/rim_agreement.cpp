#include "ros/rim_agreement.h"

#include <opencv2/imgproc.hpp>

namespace point_line_odometry {
namespace {

constexpr double kForgotten = 0.02;  // of what is known, with each frame

bool same(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size()) return false;
  if (a.data == b.data) return true;
  return cv::countNonZero(a != b) == 0;
}

}  // namespace

void RimAgreement::takeMask(const cv::Mat& left_mask) {
  if (same(left_mask, mask_)) return;
  mask_ = left_mask.clone();
  const int side = 2 * cvRound(kRim * left_mask.cols) + 1;
  cv::Mat sums;
  cv::boxFilter(left_mask == 0, sums, CV_32S, {side, side}, {-1, -1}, false, cv::BORDER_CONSTANT);
  rim_ = sums > 0;
}

void RimAgreement::add(const FrameResult& result, const cv::Mat& left_mask) {
  if (left_mask.empty()) return;
  takeMask(left_mask);
  for (Share* share : {&near_, &elsewhere_}) {
    share->points *= 1.0 - kForgotten;
    share->inliers *= 1.0 - kForgotten;
  }
  const cv::Rect image({0, 0}, rim_.size());
  for (const ObservedPoint& point : result.points) {
    const cv::Point pixel(cvRound(point.left_px.x()), cvRound(point.left_px.y()));
    if (!image.contains(pixel)) continue;
    Share& share = rim_.at<uchar>(pixel) != 0 ? near_ : elsewhere_;
    share.points += 1.0;
    share.inliers += point.inlier ? 1.0 : 0.0;
  }
}

std::optional<bool> RimAgreement::isWorseNearRim() const {
  constexpr double kFewest = 100.0;
  constexpr double kClearly = 0.15;
  if (near_.points < kFewest || elsewhere_.points < kFewest) return std::nullopt;
  return near_.agreeing() < elsewhere_.agreeing() - kClearly;
}

}  // namespace point_line_odometry
