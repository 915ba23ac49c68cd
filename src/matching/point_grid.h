#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <vector>

#include "matching/descriptor_distance.h"

namespace point_line_odometry {

/// Finds the nearest descriptors among points in a rectangle of the image. The points are sorted by
/// rectangular cells, so that those of a row of cells are contiguous. Pixels outside belong to the
/// border cells.
class PointGrid {
 public:
  PointGrid(int cell_width_px, int cell_height_px)
      : cell_width_(cell_width_px), cell_height_(cell_height_px) {}

  /// Replaces the points. A point is identified by its index in the lists.
  void fill(const std::vector<Eigen::Vector2f>& pixels,
            const std::vector<Descriptor>& descriptors) {
    Eigen::Vector2f extent = Eigen::Vector2f::Zero();
    for (const Eigen::Vector2f& pixel : pixels) extent = extent.cwiseMax(pixel);
    columns_ = static_cast<int>(extent.x()) / cell_width_ + 1;
    rows_ = static_cast<int>(extent.y()) / cell_height_ + 1;
    begins_.assign(static_cast<std::size_t>(columns_) * rows_ + 2, 0);
    // Counting sort. Counts are stored two entries further: after the sums each cell's begin is one
    // entry further, and advances to its own while the cell is filled.
    for (const Eigen::Vector2f& pixel : pixels) ++begins_[cellOf(pixel) + 2];
    for (std::size_t c = 2; c < begins_.size(); ++c) begins_[c] += begins_[c - 1];
    points_.resize(pixels.size());
    descriptors_.resize(pixels.size());
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      const int slot = begins_[cellOf(pixels[i]) + 1]++;
      points_[slot] = {pixels[i], static_cast<int>(i)};
      descriptors_[slot] = descriptors[i];
    }
  }

  /// The two nearest descriptors among the points in a window for which `accept(index, pixel)` is
  /// true.
  template <typename Accept>
  TwoNearest nearest(const Descriptor& descriptor, const Eigen::AlignedBox2f& window,
                     Accept&& accept) const {
    Batch batch;
    TwoNearest best;
    const int first_column = column(window.min().x());
    const int last_column = column(window.max().x());
    for (int r = row(window.min().y()); r <= row(window.max().y()); ++r) {
      const int end = begins_[r * columns_ + last_column + 1];
      for (int k = begins_[r * columns_ + first_column]; k < end; ++k) {
        const Point& point = points_[k];
        if (!window.contains(point.pixel) || !accept(point.index, point.pixel)) continue;
        batch.indices[batch.count++] = k;
        if (batch.count == kBatch) compare(descriptor, &batch, &best);
      }
    }
    compare(descriptor, &batch, &best);
    return best;
  }

 private:
  struct Point {
    Eigen::Vector2f pixel;
    int index;
  };

  static constexpr int kBatch = 32;
  struct Batch {
    std::array<int, kBatch> indices;
    int count = 0;
  };

  void compare(const Descriptor& descriptor, Batch* batch, TwoNearest* best) const {
    std::array<int, kBatch> distances;
    hammingDistances(descriptor, descriptors_.data(), batch->indices.data(), batch->count,
                     distances.data());
    for (int k = 0; k < batch->count; ++k)
      best->offer(points_[batch->indices[k]].index, distances[k]);
    batch->count = 0;
  }

  int column(float u) const {
    return std::clamp(static_cast<int>(u) / cell_width_, 0, columns_ - 1);
  }
  int row(float v) const { return std::clamp(static_cast<int>(v) / cell_height_, 0, rows_ - 1); }
  int cellOf(const Eigen::Vector2f& pixel) const {
    return row(pixel.y()) * columns_ + column(pixel.x());
  }

  int cell_width_;
  int cell_height_;
  int columns_ = 1;
  int rows_ = 1;
  std::vector<int> begins_{0, 0};  // of each cell in points_, and the end
  std::vector<Point> points_;
  std::vector<Descriptor> descriptors_;
};

}  // namespace point_line_odometry
