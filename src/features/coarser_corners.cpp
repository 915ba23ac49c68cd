#include "features/coarser_corners.h"

#include <algorithm>
#include <cmath>
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

/// Corners of a level, in its pixels.
std::vector<Keypoint> cornersOf(const cv::Mat& level, int octave, const FeatureMask& mask) {
  std::vector<Keypoint> corners;
  for (const EigenvalueMaximum& maximum : minEigenvalueMaxima(level, kCoarserBorder)) {
    Keypoint corner;
    corner.pixel = {static_cast<float>(maximum.x), static_cast<float>(maximum.y)};
    corner.response = maximum.value;
    corner.octave = octave;
    if (mask.allowsPatch(corner.pixel, octave)) corners.push_back(corner);
  }
  return corners;
}

using Levels = std::vector<std::vector<Keypoint>>;

/// Response of the noise's own corners, times the square of the level's scale: gradients of white
/// noise fall with the scale. Of the levels the one with the least signal tells it.
float noiseResponse(const Levels& levels, const ImagePyramid& pyramid) {
  float noise = std::numeric_limits<float>::infinity();
  for (const std::vector<Keypoint>& corners : levels) {
    if (corners.empty()) continue;
    std::vector<float> responses;
    responses.reserve(corners.size());
    for (const Keypoint& corner : corners) responses.push_back(corner.response);
    const float scale = pyramid.ratio(corners.front().octave).x();
    noise = std::min(noise, quantile(std::move(responses), kNoiseQuantile) * scale * scale);
  }
  return noise;
}

/// Corners in pixels of the full-resolution image whose response, from here on that beyond the
/// noise, is positive.
std::vector<Keypoint> aboveNoise(const Levels& levels, const ImagePyramid& pyramid) {
  const float noise = noiseResponse(levels, pyramid);
  std::vector<Keypoint> corners;
  for (const std::vector<Keypoint>& level : levels) {
    for (Keypoint corner : level) {
      const float scale = pyramid.ratio(corner.octave).x();
      corner.response -= kNoiseFactor * noise / (scale * scale);
      corner.pixel = pyramid.fromLevel(corner.pixel, corner.octave);
      if (corner.response > 0.0F) corners.push_back(corner);
    }
  }
  return corners;
}

/// The strongest corners of a cell, not near each other. Equal ones in their order.
std::vector<Keypoint> strongest(std::vector<Keypoint> corners, std::size_t max_count,
                                const ImagePyramid& pyramid) {
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Keypoint& a, const Keypoint& b) { return a.response > b.response; });
  std::vector<Keypoint> kept;
  for (const Keypoint& corner : corners) {
    if (kept.size() == max_count) break;
    const float min_distance = kMinDistance * pyramid.ratio(corner.octave).x();
    const bool near = std::any_of(kept.begin(), kept.end(), [&](const Keypoint& stronger) {
      return (stronger.pixel - corner.pixel).norm() < min_distance;
    });
    if (!near) kept.push_back(corner);
  }
  return kept;
}

}  // namespace

std::vector<Keypoint> detectCoarserCorners(const ImagePyramid& pyramid,
                                           const PointParameters& parameters, ThreadPool* threads,
                                           const FeatureMask& mask) {
  const int num_coarser = static_cast<int>(pyramid.levels.size()) - 1;
  Levels levels(static_cast<std::size_t>(num_coarser));
  const auto detect = [&](int task) {
    const auto index = static_cast<std::size_t>(task);
    levels[index] = cornersOf(pyramid.levels[index + 1], task + 1, mask);
  };
  if (threads != nullptr) {
    threads->run(num_coarser, detect);
  } else {
    for (int task = 0; task < num_coarser; ++task) detect(task);
  }
  const cv::Size size = pyramid.levels.front().size();
  CellGrid<std::vector<Keypoint>> cells(size.width, size.height, parameters.cell_size_px);
  for (const Keypoint& corner : aboveNoise(levels, pyramid))
    cells.at(corner.pixel).push_back(corner);
  const auto max_count =
      static_cast<std::size_t>(std::max(1, cvRound(kShareOfCell * parameters.max_per_cell)));
  std::vector<Keypoint> corners;
  for (const std::vector<Keypoint>& cell : cells.cells()) {
    const std::vector<Keypoint> kept = strongest(cell, max_count, pyramid);
    corners.insert(corners.end(), kept.begin(), kept.end());
  }
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Keypoint& a, const Keypoint& b) { return a.octave < b.octave; });
  return corners;
}

}  // namespace point_line_odometry
