#include "world/hill.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "world/random.h"
#include "world/scene.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kStrip_m = 1.5;  // length of the flat strips of the ground
constexpr int kStripsOfDash = 2;  // strips of a dash, within its period
constexpr int kStripsOfPeriod = 5;
constexpr int kStripsOfObject = 10;
constexpr double kVerge_m = 42.0;  // half the width of the level top
constexpr double kFoot_m = 66.0;   // where the slopes at the sides end
constexpr double kAboveGround = 0.01;
constexpr double kPaint_m = 0.004;

static_assert(kStripsOfPeriod * kStrip_m == LaneDashes::kPeriod_m);
static_assert(kStripsOfDash * kStrip_m == LaneDashes::kLength_m);

/// Both ends of a strip across the road, and the length of the ground up to it.
struct Strip {
  double x0, x1;
  double z0, z1;
  double arc_m;

  Vector3d begin(double y, double above = 0.0) const { return {x0, y, z0 + above}; }
  Vector3d end(double y, double above = 0.0) const { return {x1, y, z1 + above}; }
};

struct Ground {
  Material asphalt;
  Material grass;
  Material paint;
};

void addStrip(const Strip& s, double half_road, const Ground& ground, ObjectBuilder* builder) {
  const auto band = [&](double y0, double y1, const Material& material) {
    builder->addPolygon({s.begin(y0), s.end(y0), s.end(y1), s.begin(y1)}, material, {s.arc_m, y0});
  };
  band(-half_road, half_road, ground.asphalt);
  band(half_road, kVerge_m, ground.grass);
  band(-kVerge_m, -half_road, ground.grass);
  for (const double side : {-1.0, 1.0}) {
    const Vector3d low0(s.x0, side * kFoot_m, 0.0);
    const Vector3d low1(s.x1, side * kFoot_m, 0.0);
    std::vector<Vector3d> first = {s.begin(side * kVerge_m), s.end(side * kVerge_m), low1};
    std::vector<Vector3d> second = {s.begin(side * kVerge_m), low1, low0};
    if (side < 0.0) {
      std::swap(first[1], first[2]);
      std::swap(second[1], second[2]);
    }
    builder->addPolygon(first, ground.grass, {s.arc_m, kVerge_m});
    builder->addPolygon(second, ground.grass, {s.arc_m, kVerge_m});
  }
}

void addDash(const Strip& s, const Material& paint, ObjectBuilder* builder) {
  constexpr double kHalf = 0.5 * LaneDashes::kWidth_m;
  builder->addPolygon({s.begin(-kHalf, kPaint_m), s.end(-kHalf, kPaint_m), s.end(kHalf, kPaint_m),
                       s.begin(kHalf, kPaint_m)},
                      paint, {s.arc_m, 0.0});
}

}  // namespace

double Hill::heightAt(double x) const {
  const double phase = std::clamp((x - middle_x) / half_length_m, -1.0, 1.0);
  return height_m * 0.5 * (1.0 + std::cos(kPi * phase));
}

void addHill(const Hill& hill, const Vector2d& range_x, double road_width_m, Random* random,
             Scene* scene) {
  const Ground ground = {makeMaterial(Pattern::kRough, 0.30, 0.24, random),
                         makeMaterial(Pattern::kRough, 0.26, 0.28, random),
                         makeMaterial(Pattern::kPlain, 0.75, 0.04, random)};
  const int count = static_cast<int>((range_x.y() - range_x.x()) / kStrip_m);
  ObjectBuilder builder;
  Strip strip{};
  for (int i = 0; i < count; ++i) {
    strip.x0 = range_x.x() + i * kStrip_m;
    strip.x1 = strip.x0 + kStrip_m;
    strip.z0 = hill.heightAt(strip.x0) + kAboveGround;
    strip.z1 = hill.heightAt(strip.x1) + kAboveGround;
    addStrip(strip, 0.5 * road_width_m, ground, &builder);
    if (i % kStripsOfPeriod < kStripsOfDash) addDash(strip, ground.paint, &builder);
    strip.arc_m += std::hypot(kStrip_m, strip.z1 - strip.z0);
    if (i % kStripsOfObject == kStripsOfObject - 1 || i + 1 == count) scene->place(builder.take());
  }
}

}  // namespace point_line_odometry::world
