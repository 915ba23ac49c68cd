#include "features/image_pyramid.h"

#include <cmath>

#include "common/area_reduction.h"
#include "features/orb_descriptor.h"

namespace point_line_odometry {

void ImagePyramid::addLevels(const PointParameters& parameters) {
  const cv::Mat image = levels.front();
  levels = {image};
  constexpr int kSmallest = 2 * OrbDescriptor::kBorder;
  for (int octave = 1; octave < parameters.levels; ++octave) {
    const double scale = std::pow(parameters.scale_factor, octave);
    const cv::Size size(cvRound(image.cols / scale), cvRound(image.rows / scale));
    if (size.width <= kSmallest || size.height <= kSmallest) break;
    levels.push_back(areaReduced(levels.back(), size));
  }
}

Eigen::Array2f ImagePyramid::ratio(int octave) const {
  const cv::Size image = levels.front().size();
  const cv::Size level = levels[static_cast<std::size_t>(octave)].size();
  return {static_cast<float>(image.width) / static_cast<float>(level.width),
          static_cast<float>(image.height) / static_cast<float>(level.height)};
}

}  // namespace point_line_odometry
