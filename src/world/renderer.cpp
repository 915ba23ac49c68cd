#include "world/renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core/utility.hpp>

namespace point_line_odometry::world {
namespace {

using Eigen::Vector3d;

/// a X + b Y + c over the normalised image plane.
struct LinearForm {
  float a = 0.0F;
  float b = 0.0F;
  float c = 0.0F;

  float at(const cv::Point2f& p) const { return a * p.x + b * p.y + c; }
};

LinearForm operator-(const LinearForm& f, const LinearForm& g) {
  return {f.a - g.a, f.b - g.b, f.c - g.c};
}

/// A rectangle in the normalised image plane.
struct PlaneBlock {
  cv::Point2f centre;
  float half_width = 0.0F;
  float half_height = 0.0F;

  explicit PlaneBlock(const PlaneBounds& b)
      : centre(0.5F * (b.x_low + b.x_high), 0.5F * (b.y_low + b.y_high)),
        half_width(0.5F * (b.x_high - b.x_low)),
        half_height(0.5F * (b.y_high - b.y_low)) {}

  float spread(const LinearForm& f) const {
    return std::abs(f.a) * half_width + std::abs(f.b) * half_height;
  }
  float lowest(const LinearForm& f) const { return f.at(centre) - spread(f); }
  float highest(const LinearForm& f) const { return f.at(centre) + spread(f); }
};

/// A surface as a view sees it. With q = 1 / z of the point that a ray (X, Y, 1) hits, the values
/// q, u q, v q and e q (e: distance inside an edge) are linear in X and Y; the ray hits the polygon
/// if q > 0 and e q >= 0 for all its edges.
struct SeenSurface {
  LinearForm q;
  LinearForm uq;
  LinearForm vq;
  std::array<LinearForm, Surface::kMaxCorners> edges;
  std::size_t num_edges = 0;
  const Material* material = nullptr;
  float light = 1.0F;
  float eye_u = 0.0F;  // the eye over the surface [m]
  float eye_v = 0.0F;
  float eye_height = 1.0F;
};

struct SkyView {
  Eigen::Matrix3f R_world_camera;
  std::uint32_t seed = 0;
};

LinearForm toForm(const Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

/// Draws one view; blocks of pixels may be drawn at the same time.
class Painter {
 public:
  Painter(const Scene& scene, const std::vector<Instance>& movers, const View& view, cv::Mat* image)
      : scene_(scene),
        rays_(*view.rays),
        T_camera_world_(view.T_world_camera.inverse()),
        whole_(rays_.bounds(rays_.all())),
        haze_per_m_(static_cast<float>(1.0 / scene.haze_m)),
        image_(image) {
    sky_ = {view.T_world_camera.linear().cast<float>(), scene.seed};
    for (const Instance& instance : scene.instances) add(instance);
    for (const Instance& mover : movers) add(mover);
  }

  void paint(const PixelBlock& block) const {
    std::vector<int> candidates(surfaces_.size());
    for (std::size_t i = 0; i < candidates.size(); ++i) candidates[i] = static_cast<int>(i);
    paint(block, 0, &candidates);
  }

 private:
  void add(const Instance& instance) {
    const Object& object = scene_.objects[instance.object];
    const Vector3d centre = T_camera_world_ * (instance.T_world_object * object.centre);
    if (centre.norm() - object.radius_m > object.visible_m) return;
    if (!touchesView(centre, object.radius_m)) return;
    const Eigen::Isometry3d T_camera_object = T_camera_world_ * instance.T_world_object;
    const Vector3d towards_light = T_camera_world_.linear() * scene_.lighting.direction;
    for (const Surface& surface : object.surfaces) add(surface, T_camera_object, towards_light);
  }

  /// False if a ball in the camera's frame is outside the pyramid of the image.
  bool touchesView(const Vector3d& centre, double radius) const {
    const auto outside = [&](double tangent, double x, double sign) {
      return sign * (x - tangent * centre.z()) > radius * std::sqrt(1.0 + tangent * tangent);
    };
    return centre.z() > -radius && !outside(whole_.x_low, centre.x(), -1.0) &&
           !outside(whole_.x_high, centre.x(), 1.0) && !outside(whole_.y_low, centre.y(), -1.0) &&
           !outside(whole_.y_high, centre.y(), 1.0);
  }

  void add(const Surface& surface, const Eigen::Isometry3d& T_camera_object,
           const Vector3d& towards_light) {
    constexpr double kNearest_m = 1e-3;
    const Vector3d o = T_camera_object * surface.origin;
    const Vector3d a = T_camera_object.linear() * surface.axis_u;
    const Vector3d b = T_camera_object.linear() * surface.axis_v;
    const Vector3d n = a.cross(b);
    const double eye_height = -n.dot(o);
    if (eye_height < kNearest_m) return;  // seen from behind
    const Vector3d q = -n / eye_height;
    const Vector3d uq = a - a.dot(o) * q;
    const Vector3d vq = b - b.dot(o) * q;
    SeenSurface seen;
    seen.q = toForm(q);
    seen.num_edges = surface.num_corners;
    for (std::size_t i = 0; i < seen.num_edges; ++i) {
      const Eigen::Vector2d from = surface.corners[i].cast<double>();
      const Eigen::Vector2d to = surface.corners[(i + 1) % seen.num_edges].cast<double>();
      const Eigen::Vector2d inward(from.y() - to.y(), to.x() - from.x());
      seen.edges[i] = toForm(inward.x() * uq + inward.y() * vq - inward.dot(from) * q);
      if (PlaneBlock(whole_).highest(seen.edges[i]) < 0.0F) return;
    }
    if (PlaneBlock(whole_).highest(seen.q) <= 0.0F) return;
    seen.uq = toForm(uq);
    seen.vq = toForm(vq);
    seen.material = &surface.material;
    seen.light = lightOn(surface.material, n.dot(towards_light));
    seen.eye_u = static_cast<float>(-a.dot(o));
    seen.eye_v = static_cast<float>(-b.dot(o));
    seen.eye_height = static_cast<float>(eye_height);
    surfaces_.push_back(seen);
    bounds_.push_back(boundsOf(surface, T_camera_object));
  }

  /// Bounds of a surface's image; everything if a part of it is not in front of the camera.
  static PlaneBounds boundsOf(const Surface& surface, const Eigen::Isometry3d& T_camera_object) {
    constexpr float kFar = 1e9F;
    constexpr double kNear_m = 0.01;
    PlaneBounds bounds{kFar, -kFar, kFar, -kFar};
    for (std::size_t i = 0; i < surface.num_corners; ++i) {
      const Eigen::Vector2d corner = surface.corners[i].cast<double>();
      const Vector3d p = T_camera_object * (surface.origin + corner.x() * surface.axis_u +
                                            corner.y() * surface.axis_v);
      if (p.z() < kNear_m) return {-kFar, kFar, -kFar, kFar};
      const auto x = static_cast<float>(p.x() / p.z());
      const auto y = static_cast<float>(p.y() / p.z());
      bounds = {std::min(bounds.x_low, x), std::max(bounds.x_high, x), std::min(bounds.y_low, y),
                std::max(bounds.y_high, y)};
    }
    return bounds;
  }

  static bool overlap(const PlaneBounds& a, const PlaneBounds& b) {
    return a.x_low <= b.x_high && b.x_low <= a.x_high && a.y_low <= b.y_high && b.y_low <= a.y_high;
  }

  float lightOn(const Material& material, double cosine) const {
    if (material.shines) return 1.0F;
    const Lighting& lighting = scene_.lighting;
    // Leaves point to all sides.
    const double facing =
        material.pattern == Pattern::kLeaves ? 0.35 + 0.15 * cosine : std::max(0.0, cosine);
    return static_cast<float>(lighting.ambient + lighting.direct * facing);
  }

  enum class Cover { kNone, kPart, kWhole };

  static Cover coverOf(const SeenSurface& surface, const PlaneBlock& block) {
    const float q = surface.q.at(block.centre);
    const float q_spread = block.spread(surface.q);
    if (q + q_spread <= 0.0F) return Cover::kNone;
    bool whole = q - q_spread > 0.0F;
    for (std::size_t i = 0; i < surface.num_edges; ++i) {
      const float e = surface.edges[i].at(block.centre);
      const float spread = block.spread(surface.edges[i]);
      if (e + spread < 0.0F) return Cover::kNone;
      whole = whole && e - spread >= 0.0F;
    }
    return whole ? Cover::kWhole : Cover::kPart;
  }

  /// Paints a block. The surfaces that may be seen in it are the end of `candidates`, from `first`
  /// on; what is put behind them is taken away again.
  void paint(const PixelBlock& block, std::size_t first, std::vector<int>* candidates) const {
    const PlaneBounds bounds = rays_.bounds(block);
    const PlaneBlock plane(bounds);
    const std::size_t last = candidates->size();
    int nearest = -1;  // of those that cover the block
    float nearest_q = 0.0F;
    for (std::size_t i = first; i < last; ++i) {
      const int index = (*candidates)[i];
      if (!overlap(bounds, bounds_[static_cast<std::size_t>(index)])) continue;
      const SeenSurface& surface = surfaces_[static_cast<std::size_t>(index)];
      const Cover cover = coverOf(surface, plane);
      if (cover == Cover::kNone) continue;
      candidates->push_back(index);
      const float q = surface.q.at(plane.centre);
      if (cover == Cover::kPart || q <= nearest_q) continue;
      nearest = index;
      nearest_q = q;
    }
    if (nearest >= 0) dropHidden(plane, nearest, last, candidates);
    const std::size_t count = candidates->size() - last;
    if (count == 0) {
      paintSky(block);
    } else if (count == 1 && nearest >= 0) {
      paintSurface(block, surfaces_[static_cast<std::size_t>(nearest)]);
    } else if (block.width == 1 && block.height == 1) {
      paintMixed(block, last, *candidates);
    } else {
      for (const PixelBlock& half : halves(block)) paint(half, last, candidates);
    }
    candidates->resize(last);
  }

  void dropHidden(const PlaneBlock& plane, int nearest, std::size_t first,
                  std::vector<int>* candidates) const {
    const LinearForm& q = surfaces_[static_cast<std::size_t>(nearest)].q;
    const auto hidden = [&](int index) {
      return index != nearest &&
             plane.lowest(q - surfaces_[static_cast<std::size_t>(index)].q) >= 0.0F;
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
      float* row = image_->ptr<float>(y);
      for (int x = block.x; x < block.x + block.width; ++x) {
        row[x] = sky(inPixel(x, y, 0.5F, 0.5F));
      }
    }
  }

  float sky(const cv::Point2f& p) const {
    const Eigen::Vector3f ray = sky_.R_world_camera * Eigen::Vector3f(p.x, p.y, 1.0F);
    return skyRadiance(sky_.seed, ray.x(), ray.y(), ray.z());
  }

  void paintSurface(const PixelBlock& block, const SeenSurface& surface) const {
    for (int y = block.y; y < block.y + block.height; ++y) {
      float* row = image_->ptr<float>(y);
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
      const SeenSurface& surface = surfaces_[static_cast<std::size_t>(candidates[k])];
      for (int i = 0; i < kRays; ++i) {
        const float q = surface.q.at(points[i]);
        if (q <= nearest_q[i] || !inside(surface, points[i])) continue;
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
          index < 0 ? sky(middle)
                    : shade(surfaces_[static_cast<std::size_t>(index)], pixel.x, pixel.y, middle);
      sum += radiance * static_cast<float>(count);
    }
    image_->at<float>(pixel.y, pixel.x) = sum / kRays;
  }

  static bool inside(const SeenSurface& surface, const cv::Point2f& p) {
    for (std::size_t i = 0; i < surface.num_edges; ++i) {
      if (surface.edges[i].at(p) < 0.0F) return false;
    }
    return true;
  }

  static constexpr int kDone = -2;

  const Scene& scene_;
  const PixelRays& rays_;
  Eigen::Isometry3d T_camera_world_;
  PlaneBounds whole_;
  float haze_per_m_;
  SkyView sky_;
  std::vector<SeenSurface> surfaces_;
  std::vector<PlaneBounds> bounds_;  // of the surfaces, apart as most are looked at no closer
  cv::Mat* image_;
};

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
    const PixelBlock all = views[i].rays->all();
    images.emplace_back(all.height, all.width, CV_32FC1);
    painters.emplace_back(scene, movers, views[i], &images.back());
    for (int x = 0; x < all.width; x += kStripWidth) {
      strips.push_back({i, {x, 0, std::min(kStripWidth, all.width - x), all.height}});
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
