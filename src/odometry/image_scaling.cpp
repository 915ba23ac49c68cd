#include "odometry/image_scaling.h"

#include <algorithm>
#include <cmath>

#include "common/image_resize.h"

namespace point_line_odometry {
namespace {

/// The whole number by which width and height change, so that the area does by `ratio` or more.
int factorFor(double ratio) { return std::max(static_cast<int>(std::ceil(std::sqrt(ratio))), 1); }

/// Never beyond what would be reduced.
int enlargementOf(double megapixels, const TrackingParameters& parameters) {
  int factor = factorFor(parameters.min_megapixels / megapixels);
  while (factor > 1 && factor * factor * megapixels > parameters.max_megapixels) --factor;
  return factor;
}

/// Integer pixels are centres: pixel u of the input is (u + 0.5) / ratio - 0.5.
StereoCamera scaledCamera(StereoCamera camera, int reduction, int enlargement) {
  const double ratio = static_cast<double>(reduction) / enlargement;
  camera.fx /= ratio;
  camera.fy /= ratio;
  camera.cx = (camera.cx + 0.5) / ratio - 0.5;
  camera.cy = (camera.cy + 0.5) / ratio - 0.5;
  camera.width = camera.width / reduction * enlargement;
  camera.height = camera.height / reduction * enlargement;
  return camera;
}

}  // namespace

ImageScaling::ImageScaling(const StereoCamera& camera, const TrackingParameters& parameters) {
  const double megapixels = 1e-6 * camera.width * camera.height;
  reduction_ = factorFor(megapixels / parameters.max_megapixels);
  enlargement_ = enlargementOf(megapixels, parameters);
  camera_ = scaledCamera(camera, reduction_, enlargement_);
}

StereoImages ImageScaling::scale(const StereoImages& images) const {
  if (reduction_ == 1 && enlargement_ == 1) return images;
  const cv::Size size(camera_.width, camera_.height);
  const auto whole_squares = [&](const cv::Mat& image) {
    return image.empty() ? image : image(cv::Rect({0, 0}, size * reduction_ / enlargement_));
  };
  return {resized(whole_squares(images.left), size), resized(whole_squares(images.right), size),
          images.stamp_ns, resizedMask(whole_squares(images.left_mask), size),
          resizedMask(whole_squares(images.right_mask), size)};
}

void ImageScaling::toInputPixels(FrameResult* result) const {
  if (reduction_ == 1 && enlargement_ == 1) return;
  const float ratio = static_cast<float>(reduction_) / static_cast<float>(enlargement_);
  const auto toInput = [ratio](Eigen::Vector2f* pixel) {
    *pixel = (ratio * (pixel->array() + 0.5F) - 0.5F).matrix().eval();
  };
  const auto segmentToInput = [&](LineSegment* segment) {
    toInput(&segment->start);
    toInput(&segment->end);
  };
  for (ObservedPoint& point : result->points) {
    toInput(&point.left_px);
    toInput(&point.right_px);
    point.residual_px *= ratio;
    point.vertical_disparity_px *= ratio;
  }
  for (ObservedLine& line : result->lines) {
    segmentToInput(&line.left_px);
    segmentToInput(&line.right_px);
  }
  for (Eigen::Vector2f& pixel : result->unmatched_points_px) toInput(&pixel);
  for (LineSegment& segment : result->unmatched_lines_px) segmentToInput(&segment);
  result->rms_px *= ratio;
}

}  // namespace point_line_odometry
