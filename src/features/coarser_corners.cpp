#include "features/coarser_corners.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "common/cell_grid.h"
#include "common/statistics.h"
#include "features/structure_tensor.h"

namespace point_line_odometry {
namespace {

// Corners in a cell / points/max_per_cell: more than the frame will use, as not all have a stereo
// match.
constexpr double kShareOfCell = 0.3;
constexpr float kMinDistance = 5.0F;  // to a stronger corner [px of the level of the weaker one]

// The corners of noise alone have responses within a factor of two: their 95th percentile is 1.9
// times the 20th.
constexpr double kNoiseQuantile = 0.2;
constexpr float kNoiseFactor = 2.0F;

/// A corner before its selection: of thousands, a few hundred become keypoints.
struct Corner {
  Eigen::Vector2f pixel;  // in the full-resolution image
  float response = 0.0F;
  int octave = 0;
};

using Maxima = std::vector<EigenvalueMaximum>;

Maxima maximaOf(const cv::Mat& level, int octave, const FeatureMask& mask) {
  Maxima maxima = minEigenvalueMaxima(level, kCoarserBorder);
  const auto masked = [&](const EigenvalueMaximum& maximum) {
    return !mask.allowsPatch({static_cast<float>(maximum.x), static_cast<float>(maximum.y)},
                             octave);
  };
  maxima.erase(std::remove_if(maxima.begin(), maxima.end(), masked), maxima.end());
  return maxima;
}

/// Response of the noise's own corners, times the square of the level's scale: gradients of white
/// noise fall with the scale. Of the levels the one with the least signal tells it.
float noiseResponse(const std::vector<Maxima>& levels, const ImagePyramid& pyramid) {
  float noise = std::numeric_limits<float>::infinity();
  for (std::size_t level = 0; level < levels.size(); ++level) {
    if (levels[level].empty()) continue;
    std::vector<float> responses;
    responses.reserve(levels[level].size());
    for (const EigenvalueMaximum& maximum : levels[level]) responses.push_back(maximum.value);
    const float scale = pyramid.ratio(static_cast<int>(level) + 1).x();
    noise = std::min(noise, quantile(std::move(responses), kNoiseQuantile) * scale * scale);
  }
  return noise;
}

/// Corners whose response, from here on that beyond the noise, is positive.
std::vector<Corner> aboveNoise(const std::vector<Maxima>& levels, const ImagePyramid& pyramid) {
  const float noise = noiseResponse(levels, pyramid);
  std::vector<Corner> corners;
  for (std::size_t level = 0; level < levels.size(); ++level) {
    const int octave = static_cast<int>(level) + 1;
    const float scale = pyramid.ratio(octave).x();
    const float of_noise = kNoiseFactor * noise / (scale * scale);
    for (const EigenvalueMaximum& maximum : levels[level]) {
      const float response = maximum.value - of_noise;
      if (!(response > 0.0F)) continue;
      const Eigen::Vector2f pixel(static_cast<float>(maximum.x), static_cast<float>(maximum.y));
      corners.push_back({pyramid.fromLevel(pixel, octave), response, octave});
    }
  }
  return corners;
}

/// The strongest corners of a cell, not near each other. Equal ones in their order.
std::vector<Corner> strongest(std::vector<Corner> corners, std::size_t max_count,
                              const ImagePyramid& pyramid) {
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Corner& a, const Corner& b) { return a.response > b.response; });
  std::vector<Corner> kept;
  for (const Corner& corner : corners) {
    if (kept.size() == max_count) break;
    const float min_distance = kMinDistance * pyramid.ratio(corner.octave).x();
    const bool near = std::any_of(kept.begin(), kept.end(), [&](const Corner& stronger) {
      return (stronger.pixel - corner.pixel).norm() < min_distance;
    });
    if (!near) kept.push_back(corner);
  }
  return kept;
}

Keypoint keypointAt(const Corner& corner) {
  Keypoint keypoint;
  keypoint.pixel = corner.pixel;
  keypoint.response = corner.response;
  keypoint.octave = corner.octave;
  return keypoint;
}

}  // namespace

std::vector<Keypoint> detectCoarserCorners(const ImagePyramid& pyramid,
                                           const PointParameters& parameters, ThreadPool* threads,
                                           const FeatureMask& mask) {
  const int num_coarser = static_cast<int>(pyramid.levels.size()) - 1;
  std::vector<Maxima> levels(static_cast<std::size_t>(num_coarser));
  const auto detect = [&](int task) {
    const auto index = static_cast<std::size_t>(task);
    levels[index] = maximaOf(pyramid.levels[index + 1], task + 1, mask);
  };
  if (threads != nullptr) {
    threads->run(num_coarser, detect);
  } else {
    for (int task = 0; task < num_coarser; ++task) detect(task);
  }
  const cv::Size size = pyramid.levels.front().size();
  CellGrid<std::vector<Corner>> cells(size.width, size.height, parameters.cell_size_px);
  for (const Corner& corner : aboveNoise(levels, pyramid)) cells.at(corner.pixel).push_back(corner);
  const auto max_count =
      static_cast<std::size_t>(std::max(1, cvRound(kShareOfCell * parameters.max_per_cell)));
  std::vector<Keypoint> corners;
  for (const std::vector<Corner>& cell : cells.cells()) {
    const std::vector<Corner> kept = strongest(cell, max_count, pyramid);
    std::transform(kept.begin(), kept.end(), std::back_inserter(corners), keypointAt);
  }
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Keypoint& a, const Keypoint& b) { return a.octave < b.octave; });
  return corners;
}

}  // namespace point_line_odometry
