#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

namespace point_line_odometry {

/// Square part of an image.
struct PatchArea {
  Eigen::Vector2d center_px;
  double side_px;  ///< 0: none, which overlaps with nothing
};

/// Area that two patches have in common, relative to the geometric mean of their areas: the
/// correlation of means of white noise over them. 0 ... 1
inline double overlap(const PatchArea& a, const PatchArea& b) {
  if (!(a.side_px > 0.0) || !(b.side_px > 0.0)) return 0.0;
  const Eigen::Array2d distance = (a.center_px - b.center_px).array().abs();
  const double smaller = std::min(a.side_px, b.side_px);
  const Eigen::Array2d common = (0.5 * (a.side_px + b.side_px) - distance).min(smaller).max(0.0);
  return common.prod() / (a.side_px * b.side_px);
}

/// Calls visit(i, j, overlap) once for each pair of patches that overlap.
template <typename Visit>
void forEachOverlap(const std::vector<PatchArea>& patches, Visit&& visit) {
  double largest_px = 0.0;
  for (const PatchArea& patch : patches) largest_px = std::max(largest_px, patch.side_px);
  std::vector<std::size_t> by_column(patches.size());
  std::iota(by_column.begin(), by_column.end(), std::size_t{0});
  std::stable_sort(by_column.begin(), by_column.end(), [&](std::size_t i, std::size_t j) {
    return patches[i].center_px.x() < patches[j].center_px.x();
  });
  for (auto a = by_column.begin(); a != by_column.end(); ++a) {
    for (auto b = a + 1; b != by_column.end(); ++b) {
      if (patches[*b].center_px.x() - patches[*a].center_px.x() >= largest_px) break;
      const double common = overlap(patches[*a], patches[*b]);
      if (common > 0.0) visit(*a, *b, common);
    }
  }
}

}  // namespace point_line_odometry
