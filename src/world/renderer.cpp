#include "world/renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core/utility.hpp>

#include "world/shading.h"
#include "world/sky.h"
#include "world/visible_surfaces.h"

namespace point_line_odometry::world {
namespace {

/// Draws one view; blocks of pixels may be drawn at the same time.
class Painter {
 public:
  /// \param area of the view that `image` shows.
  Painter(const Scene& scene, const std::vector<Instance>& movers, const View& view,
          const PixelBlock& area, cv::Mat* image)
      : rays_(*view.rays),
        sky_{scene.seed, static_cast<float>(scene.clouds)},
        R_world_camera_(view.T_world_camera.linear().cast<float>()),
        haze_per_m_(static_cast<float>(1.0 / scene.haze_m)),
        visible_(findVisibleSurfaces(scene, movers, view.T_world_camera, rays_.bounds(area))),
        first_row_(area.y),
        image_(image) {}

  void paint(const PixelBlock& block) const {
    std::vector<int> candidates(visible_.surfaces.size());
    for (std::size_t i = 0; i < candidates.size(); ++i) candidates[i] = static_cast<int>(i);
    Samples samples(visible_.surfaces.size() + 1);
    sample(block, 0, &candidates, &samples);
    write(&samples);
  }

 private:
  const SeenSurface& surface(int index) const {
    return visible_.surfaces[static_cast<std::size_t>(index)];
  }

  void write(Samples* samples) const {
    samples->write([this](std::size_t seen, const SampleBatch& batch, std::size_t size) {
      if (seen == sky()) {
        shadeSky(sky_, R_world_camera_, batch, size);
      } else {
        shadeSurface(visible_.surfaces[seen], haze_per_m_, batch, size);
      }
    });
  }

  /// The sky's place in the samples, after the surfaces.
  std::size_t sky() const { return visible_.surfaces.size(); }

  static bool overlap(const PlaneBounds& a, const PlaneBounds& b) {
    return a.x_low <= b.x_high && b.x_low <= a.x_high && a.y_low <= b.y_high && b.y_low <= a.y_high;
  }

  enum class Cover { kNone, kPart, kWhole };

  static Cover coverOf(const SeenSurface& surface, const PlaneBlock& block) {
    const float q = surface.q.at(block.centre);
    const float q_half_range = block.halfRange(surface.q);
    if (q + q_half_range <= 0.0F) return Cover::kNone;
    bool whole = q - q_half_range > 0.0F;
    for (std::size_t i = 0; i < surface.num_edges; ++i) {
      const float e = surface.edges[i].at(block.centre);
      const float half_range = block.halfRange(surface.edges[i]);
      if (e + half_range < 0.0F) return Cover::kNone;
      whole = whole && e - half_range >= 0.0F;
    }
    return whole ? Cover::kWhole : Cover::kPart;
  }

  /// Finds what is seen in a block. The surfaces that may be are the end of `candidates`, from
  /// `first` on; those appended here are removed again.
  void sample(const PixelBlock& block, std::size_t first, std::vector<int>* candidates,
              Samples* samples) const {
    const PlaneBounds bounds = rays_.bounds(block);
    const PlaneBlock plane(bounds);
    const std::size_t last = candidates->size();
    int nearest = -1;  // nearest surface that covers the block
    float nearest_q = 0.0F;
    for (std::size_t i = first; i < last; ++i) {
      const int index = (*candidates)[i];
      if (!overlap(bounds, visible_.bounds[static_cast<std::size_t>(index)])) continue;
      const SeenSurface& seen = surface(index);
      const Cover cover = coverOf(seen, plane);
      if (cover == Cover::kNone) continue;
      candidates->push_back(index);
      const float q = seen.q.at(plane.centre);
      if (cover == Cover::kPart || q <= nearest_q) continue;
      nearest = index;
      nearest_q = q;
    }
    if (nearest >= 0) dropHidden(plane, nearest, last, candidates);
    const std::size_t count = candidates->size() - last;
    if (count == 0) {
      sampleWhole(block, sky(), samples);
    } else if (count == 1 && nearest >= 0) {
      sampleWhole(block, static_cast<std::size_t>(nearest), samples);
    } else if (block.width == 1 && block.height == 1) {
      sampleMixed(block, last, *candidates, samples);
    } else {
      for (const PixelBlock& half : halves(block)) sample(half, last, candidates, samples);
    }
    candidates->resize(last);
  }

  void dropHidden(const PlaneBlock& plane, int nearest, std::size_t first,
                  std::vector<int>* candidates) const {
    const LinearForm& q = surface(nearest).q;
    const auto hidden = [&](int index) {
      return index != nearest && plane.lowest(q - surface(index).q) >= 0.0F;
    };
    candidates->erase(std::remove_if(candidates->begin() + static_cast<std::ptrdiff_t>(first),
                                     candidates->end(), hidden),
                      candidates->end());
  }

  static std::array<PixelBlock, 2> halves(const PixelBlock& b) {
    if (b.width >= b.height) {
      const int half = b.width / 2;
      return {{{b.x, b.y, half, b.height}, {b.x + half, b.y, b.width - half, b.height}}};
    }
    const int half = b.height / 2;
    return {{{b.x, b.y, b.width, half}, {b.x, b.y + half, b.width, b.height - half}}};
  }

  /// Position in a pixel, (0, 0) ... (1, 1), in the normalised image plane.
  cv::Point2f inPixel(int x, int y, float right, float down) const {
    const cv::Point2f& c00 = rays_.corner(x, y);
    const cv::Point2f& c11 = rays_.corner(x + 1, y + 1);
    const cv::Point2f top = c00 + right * (rays_.corner(x + 1, y) - c00);
    const cv::Point2f bottom = rays_.corner(x, y + 1) + right * (c11 - rays_.corner(x, y + 1));
    return top + down * (bottom - top);
  }

  Sample sampleOf(int x, int y, const cv::Point2f& at, int rays) const {
    Sample sample;
    sample.pixel = image_->ptr<float>(y - first_row_, x);
    sample.at = at;
    sample.extent = rays_.corner(x + 1, y + 1) - rays_.corner(x, y);
    sample.rays = rays;
    return sample;
  }

  void sampleWhole(const PixelBlock& block, std::size_t surface, Samples* samples) const {
    for (int y = block.y; y < block.y + block.height; ++y) {
      for (int x = block.x; x < block.x + block.width; ++x) {
        if (!samples->hasRoomForPixel()) write(samples);
        samples->add(surface, sampleOf(x, y, inPixel(x, y, 0.5F, 0.5F), Samples::kRays));
      }
    }
  }

  /// A pixel in which more than one surface may be seen: each is sampled once, in the middle of its
  /// rays.
  void sampleMixed(const PixelBlock& pixel, std::size_t first, const std::vector<int>& candidates,
                   Samples* samples) const {
    constexpr int kRays = Samples::kRays;
    if (!samples->hasRoomForPixel()) write(samples);
    std::array<cv::Point2f, kRays> points;
    std::array<float, kRays> nearest_q{};
    std::array<int, kRays> nearest;
    nearest.fill(-1);
    for (int i = 0; i < kRays; ++i) {  // Hammersley's points
      const int reversed = ((i & 1) << 3) | ((i & 2) << 1) | ((i & 4) >> 1) | ((i & 8) >> 3);
      points[i] = inPixel(pixel.x, pixel.y, (i + 0.5F) / kRays, (reversed + 0.5F) / kRays);
    }
    for (std::size_t k = first; k < candidates.size(); ++k) {
      const SeenSurface& seen = surface(candidates[k]);
      for (int i = 0; i < kRays; ++i) {
        const float q = seen.q.at(points[i]);
        if (q <= nearest_q[i] || !inside(seen, points[i])) continue;
        nearest_q[i] = q;
        nearest[i] = candidates[k];
      }
    }
    for (int i = 0; i < kRays; ++i) {
      if (nearest[i] == kDone) continue;
      const int index = nearest[i];
      cv::Point2f middle(0.0F, 0.0F);
      int count = 0;
      for (int k = i; k < kRays; ++k) {
        if (nearest[k] != index) continue;
        middle += points[k];
        ++count;
        nearest[k] = kDone;
      }
      middle *= 1.0F / static_cast<float>(count);
      samples->add(index < 0 ? sky() : static_cast<std::size_t>(index),
                   sampleOf(pixel.x, pixel.y, middle, count));
    }
  }

  static bool inside(const SeenSurface& surface, const cv::Point2f& p) {
    for (std::size_t i = 0; i < surface.num_edges; ++i) {
      if (surface.edges[i].at(p) < 0.0F) return false;
    }
    return true;
  }

  static constexpr int kDone = -2;

  const PixelRays& rays_;
  Sky sky_;
  Eigen::Matrix3f R_world_camera_;
  float haze_per_m_;
  VisibleSurfaces visible_;
  int first_row_;
  cv::Mat* image_;
};

PixelBlock areaOf(const View& view) {
  PixelBlock area = view.rays->all();
  if (view.rows != cv::Range::all()) {
    area.y = view.rows.start;
    area.height = view.rows.size();
  }
  return area;
}

}  // namespace

std::vector<cv::Mat> render(const Scene& scene, const std::vector<Instance>& movers,
                            const std::vector<View>& views) {
  constexpr int kStripWidth = 96;
  std::vector<cv::Mat> images;
  std::vector<Painter> painters;
  std::vector<std::pair<std::size_t, PixelBlock>> strips;
  images.reserve(views.size());
  painters.reserve(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    const PixelBlock area = areaOf(views[i]);
    images.emplace_back(area.height, area.width, CV_32FC1);
    painters.emplace_back(scene, movers, views[i], area, &images.back());
    for (int x = 0; x < area.width; x += kStripWidth) {
      strips.push_back({i, {x, area.y, std::min(kStripWidth, area.width - x), area.height}});
    }
  }
  cv::parallel_for_(
      cv::Range(0, static_cast<int>(strips.size())),
      [&](const cv::Range& range) {
        for (int k = range.start; k < range.end; ++k) {
          const auto& [view, block] = strips[static_cast<std::size_t>(k)];
          painters[view].paint(block);
        }
      },
      static_cast<double>(strips.size()));
  return images;
}

}  // namespace point_line_odometry::world
