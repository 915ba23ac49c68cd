#include "world/renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core/utility.hpp>

#include "world/visible_surfaces.h"

namespace point_line_odometry::world {
namespace {

struct SkyView {
  Eigen::Matrix3f R_world_camera;
  std::uint32_t seed = 0;
  float clouds = 0.0F;
};

/// Draws one view; blocks of pixels may be drawn at the same time.
class Painter {
 public:
  /// \param area of the view that `image` shows.
  Painter(const Scene& scene, const std::vector<Instance>& movers, const View& view,
          const PixelBlock& area, cv::Mat* image)
      : rays_(*view.rays),
        sky_{view.T_world_camera.linear().cast<float>(), scene.seed,
             static_cast<float>(scene.clouds)},
        haze_per_m_(static_cast<float>(1.0 / scene.haze_m)),
        visible_(findVisibleSurfaces(scene, movers, view.T_world_camera, rays_.bounds(area))),
        first_row_(area.y),
        image_(image) {}

  void paint(const PixelBlock& block) const {
    std::vector<int> candidates(visible_.surfaces.size());
    for (std::size_t i = 0; i < candidates.size(); ++i) candidates[i] = static_cast<int>(i);
    paint(block, 0, &candidates);
  }

 private:
  const SeenSurface& surface(int index) const {
    return visible_.surfaces[static_cast<std::size_t>(index)];
  }

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

  /// Paints a block. The surfaces that may be seen in it are the end of `candidates`, from `first`
  /// on; those appended here are removed again.
  void paint(const PixelBlock& block, std::size_t first, std::vector<int>* candidates) const {
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
      paintSky(block);
    } else if (count == 1 && nearest >= 0) {
      paintSurface(block, surface(nearest));
    } else if (block.width == 1 && block.height == 1) {
      paintMixed(block, last, *candidates);
    } else {
      for (const PixelBlock& half : halves(block)) paint(half, last, candidates);
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

  void paintSky(const PixelBlock& block) const {
    for (int y = block.y; y < block.y + block.height; ++y) {
      float* row = image_->ptr<float>(y - first_row_);
      for (int x = block.x; x < block.x + block.width; ++x) {
        row[x] = sky(inPixel(x, y, 0.5F, 0.5F));
      }
    }
  }

  float sky(const cv::Point2f& p) const {
    const Eigen::Vector3f ray = sky_.R_world_camera * Eigen::Vector3f(p.x, p.y, 1.0F);
    return skyRadiance(sky_.seed, sky_.clouds, ray.x(), ray.y(), ray.z());
  }

  void paintSurface(const PixelBlock& block, const SeenSurface& surface) const {
    for (int y = block.y; y < block.y + block.height; ++y) {
      float* row = image_->ptr<float>(y - first_row_);
      for (int x = block.x; x < block.x + block.width; ++x) {
        row[x] = shade(surface, x, y, inPixel(x, y, 0.5F, 0.5F));
      }
    }
  }

  float shade(const SeenSurface& s, int x, int y, const cv::Point2f& p) const {
    const cv::Point2f pixel = rays_.corner(x + 1, y + 1) - rays_.corner(x, y);
    const float q = s.q.at(p);
    const float z = 1.0F / q;
    Patch patch;
    patch.u = s.uq.at(p) * z;
    patch.v = s.vq.at(p) * z;
    patch.size_u = z * (std::abs((s.uq.a - patch.u * s.q.a) * pixel.x) +
                        std::abs((s.uq.b - patch.u * s.q.b) * pixel.y));
    patch.size_v = z * (std::abs((s.vq.a - patch.v * s.q.a) * pixel.x) +
                        std::abs((s.vq.b - patch.v * s.q.b) * pixel.y));
    patch.slope_u = (patch.u - s.eye_u) / s.eye_height;
    patch.slope_v = (patch.v - s.eye_v) / s.eye_height;
    constexpr float kHazeRadiance = 0.8F;
    const float clear = q / (q + haze_per_m_);
    return clear * s.light * reflectance(*s.material, patch) + (1.0F - clear) * kHazeRadiance;
  }

  /// A pixel in which more than one surface may be seen: the mean over 16 rays, each surface
  /// shaded once at the middle of its rays.
  void paintMixed(const PixelBlock& pixel, std::size_t first,
                  const std::vector<int>& candidates) const {
    constexpr int kRays = 16;
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
    float sum = 0.0F;
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
      const float radiance =
          index < 0 ? sky(middle) : shade(surface(index), pixel.x, pixel.y, middle);
      sum += radiance * static_cast<float>(count);
    }
    image_->at<float>(pixel.y - first_row_, pixel.x) = sum / kRays;
  }

  static bool inside(const SeenSurface& surface, const cv::Point2f& p) {
    for (std::size_t i = 0; i < surface.num_edges; ++i) {
      if (surface.edges[i].at(p) < 0.0F) return false;
    }
    return true;
  }

  static constexpr int kDone = -2;

  const PixelRays& rays_;
  SkyView sky_;
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
