#include "world/bonnet.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "common/segment_distance.h"
#include "world/random.h"

namespace point_line_odometry::world {
namespace {

// The sheet in the left camera: y = kBelow + kSlope (z - kRear) + kBend x^2.
constexpr float kBelow = 0.5F;
constexpr float kSlope = 0.04F;
constexpr float kRear = 2.0F;
constexpr float kBend = 0.04F;
constexpr float kNearest = 0.2F;
constexpr double kFront = 2.9;
constexpr float kHalfWidth = 1.7F;
constexpr float kRoundness = 0.15F;  // of the front edge [1/m]

constexpr float kPaint = 0.2F;
constexpr float kGloss = 0.35F;

constexpr int kNumScratches = 80;
constexpr float kScratchWidth = 0.008F;
constexpr int kRays = 4;  // per pixel, in each direction

}  // namespace

Bonnet::Bonnet(const std::vector<PixelRays>& rays, const Eigen::Isometry3d& T_left_right,
               double length, std::uint32_t seed, int margin_px)
    : front_(static_cast<float>(kFront * length)), seed_(seed) {
  Random random(seed);
  for (int i = 0; i < kNumScratches; ++i) {
    const double x = random.uniform(-kHalfWidth, kHalfWidth);
    const double z = random.uniform(1.0, front_);
    const double angle = random.uniform(0.0, 2.0 * M_PI);
    const double size = random.uniform(0.1, 0.5);
    scratches_.push_back(
        {Eigen::Vector2d(x, z).cast<float>(),
         Eigen::Vector2d(x + size * std::cos(angle), z + size * std::sin(angle)).cast<float>()});
  }
  views_.push_back(see(rays[0], Eigen::Isometry3d::Identity(), margin_px));
  views_.push_back(see(rays[1], T_left_right, margin_px));
}

/// The nearest point of the sheet on a ray from a camera; false if there is none.
bool Bonnet::hit(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                 Eigen::Vector3f* p) const {
  const float a = kBend * direction.x() * direction.x();
  const float b =
      2.0F * kBend * origin.x() * direction.x() + kSlope * direction.z() - direction.y();
  const float c =
      kBelow + kSlope * (origin.z() - kRear) + kBend * origin.x() * origin.x() - origin.y();
  const float root = b * b - 4.0F * a * c;
  if (!(b < 0.0F) || root < 0.0F) return false;
  // In this form the nearer root is exact also for a = 0.
  *p = origin + 2.0F * c / (-b + std::sqrt(root)) * direction;
  return p->z() > kNearest && std::abs(p->x()) < kHalfWidth &&
         p->z() < front_ - kRoundness * p->x() * p->x();
}

/// Of the paint at a place of the sheet.
float Bonnet::brightness(float x, float z) const {
  // Worn paint and stickers.
  constexpr float kCellX = 0.07F;
  constexpr float kCellZ = 0.13F;
  constexpr float kWornShare = 0.3F;
  const std::uint32_t cell =
      hash(seed_, static_cast<std::uint32_t>(static_cast<int>(std::floor(x / kCellX)) + 1000),
           static_cast<std::uint32_t>(static_cast<int>(std::floor(z / kCellZ)) + 1000));
  float light = unit(cell, 0) < kWornShare ? 0.05F + 0.6F * unit(cell, 1) : kPaint;
  const Eigen::Vector2f p(x, z);
  for (const Scratch& scratch : scratches_) {
    if (distanceToSegment(scratch.from, scratch.to, p) < 0.5F * kScratchWidth) light = 0.75F;
  }
  // Gaps between sheets, with bolts beside them.
  constexpr float kGap = 0.01F;
  constexpr float kSheet = 0.55F;
  constexpr float kBoltStep = 0.15F;
  constexpr float kBoltRadius = 0.02F;
  const float from_gap = std::abs(std::abs(x) - kSheet);
  const Eigen::Vector2f from_bolt(from_gap - 0.06F, z - kBoltStep * std::round(z / kBoltStep));
  if (from_bolt.norm() < kBoltRadius) light = 0.9F;
  return from_gap < kGap ? 0.02F : light;
}

Bonnet::View Bonnet::see(const PixelRays& rays, const Eigen::Isometry3d& T_left_camera,
                         int margin_px) const {
  const cv::Size size(rays.width(), rays.height());
  View view{cv::Mat(size, CV_32FC1, cv::Scalar(0)),
            cv::Mat(size, CV_32FC1, cv::Scalar(0)),
            cv::Mat(size, CV_32FC3, cv::Scalar::all(0)),
            {}};
  const Eigen::Vector3f origin = T_left_camera.translation().cast<float>();
  const Eigen::Matrix3f R = T_left_camera.linear().cast<float>();
  constexpr float kShare = 1.0F / (kRays * kRays);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const cv::Point2f corner = rays.corner(x, y);
      const cv::Point2f right = rays.corner(x + 1, y) - corner;
      const cv::Point2f down = rays.corner(x, y + 1) - corner;
      Eigen::Vector3f reflected = Eigen::Vector3f::Zero();
      for (int i = 0; i < kRays * kRays; ++i) {
        const int row = i / kRays;
        const cv::Point2f at = corner + (static_cast<float>(i % kRays) + 0.5F) / kRays * right +
                               (static_cast<float>(row) + 0.5F) / kRays * down;
        const Eigen::Vector3f direction = R * Eigen::Vector3f(at.x, at.y, 1.0F);
        Eigen::Vector3f p;
        if (!hit(origin, direction, &p)) continue;
        const Eigen::Vector3f up =
            Eigen::Vector3f(2.0F * kBend * p.x(), -1.0F, kSlope).normalized();
        reflected += direction - 2.0F * direction.dot(up) * up;
        view.cover.at<float>(y, x) += kShare;
        view.paint.at<float>(y, x) += kShare * brightness(p.x(), p.z());
      }
      view.reflection.at<cv::Vec3f>(y, x) = {reflected.x(), reflected.y(), reflected.z()};
    }
  }
  const int side = 2 * margin_px + 1;
  cv::Mat seen;
  cv::dilate(view.cover > 0.0F, seen, cv::Mat(side, side, CV_8UC1, cv::Scalar(1)));
  view.mask = seen == 0;
  return view;
}

void Bonnet::paint(std::size_t camera, const Eigen::Matrix3d& R_world_left, const Sky& sky,
                   cv::Mat* light) const {
  const View& view = views_[camera];
  const Eigen::Matrix3f R = R_world_left.cast<float>();
  RayBatch to_sky;
  std::array<cv::Point, kBatch> pixels;
  const auto paintBatch = [&]() {
    Values gloss;
    skyRadiance(sky, to_sky, &gloss);
    for (std::size_t i = 0; i < to_sky.size; ++i) {
      const float cover = view.cover.at<float>(pixels[i]);
      float& out = light->at<float>(pixels[i]);
      out = (1.0F - cover) * out + view.paint.at<float>(pixels[i]) + cover * (kGloss * gloss[i]);
    }
    to_sky.size = 0;
  };
  for (int y = 0; y < light->rows; ++y) {
    const float* cover = view.cover.ptr<float>(y);
    const auto* reflection = view.reflection.ptr<cv::Vec3f>(y);
    for (int x = 0; x < light->cols; ++x) {
      if (cover[x] == 0.0F) continue;
      const cv::Vec3f& r = reflection[x];
      const Eigen::Vector3f ray = R * Eigen::Vector3f(r[0], r[1], r[2]);
      pixels[to_sky.size] = cv::Point(x, y);
      to_sky.x[to_sky.size] = ray.x();
      to_sky.y[to_sky.size] = ray.y();
      to_sky.z[to_sky.size] = ray.z();
      if (++to_sky.size == kBatch) paintBatch();
    }
  }
  paintBatch();
}

}  // namespace point_line_odometry::world
