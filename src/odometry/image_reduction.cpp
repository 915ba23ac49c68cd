#include "odometry/image_reduction.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace point_line_odometry {
namespace {

int factorFor(const StereoCamera& camera, double max_megapixels) {
  const double megapixels = 1e-6 * camera.width * camera.height;
  return std::max(static_cast<int>(std::ceil(std::sqrt(megapixels / max_megapixels))), 1);
}

/// Centres of pixels: what lies at u in the large image comes to (u + 0.5) / factor - 0.5.
StereoCamera reducedCamera(StereoCamera camera, int factor) {
  camera.fx /= factor;
  camera.fy /= factor;
  camera.cx = (camera.cx + 0.5) / factor - 0.5;
  camera.cy = (camera.cy + 0.5) / factor - 0.5;
  camera.width /= factor;
  camera.height /= factor;
  return camera;
}

}  // namespace

ImageReduction::ImageReduction(const StereoCamera& camera, const TrackingParameters& parameters)
    : factor_(factorFor(camera, parameters.max_megapixels)),
      camera_(reducedCamera(camera, factor_)) {}

StereoImages ImageReduction::reduce(const StereoImages& images) const {
  if (factor_ == 1) return images;
  const auto reduced = [&](const cv::Mat& image) {
    const cv::Rect whole_squares(0, 0, factor_ * camera_.width, factor_ * camera_.height);
    cv::Mat small;
    cv::resize(image(whole_squares), small, {camera_.width, camera_.height}, 0.0, 0.0,
               cv::INTER_AREA);
    return small;
  };
  return {reduced(images.left), reduced(images.right), images.stamp_ns};
}

void ImageReduction::toInputPixels(FrameResult* result) const {
  if (factor_ == 1) return;
  const auto enlarge = [factor = static_cast<float>(factor_)](Eigen::Vector2f* pixel) {
    *pixel = (factor * (pixel->array() + 0.5F) - 0.5F).matrix().eval();
  };
  const auto enlargeSegment = [&](LineSegment* segment) {
    enlarge(&segment->start);
    enlarge(&segment->end);
  };
  for (ObservedPoint& point : result->points) {
    enlarge(&point.left_px);
    enlarge(&point.right_px);
  }
  for (ObservedLine& line : result->lines) {
    enlargeSegment(&line.left_px);
    enlargeSegment(&line.right_px);
  }
  for (Eigen::Vector2f& pixel : result->unmatched_points_px) enlarge(&pixel);
  for (LineSegment& segment : result->unmatched_lines_px) enlargeSegment(&segment);
  result->rms_px *= factor_;
}

}  // namespace point_line_odometry
