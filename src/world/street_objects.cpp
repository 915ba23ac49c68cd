#include "world/street_objects.h"

#include <cmath>
#include <vector>

#include "world/random.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// Largest distances at which they are drawn [m].
constexpr double kDrawCars = 180.0;
constexpr double kDrawTrees = 220.0;

/// A crown as an uneven ball of flat leaves.
void addCrown(double foot, double radius, double height, Random* random, ObjectBuilder* builder) {
  constexpr int kRings = 5;
  constexpr int kSides = 9;
  std::vector<std::vector<Vector3d>> rings;
  for (int r = 0; r < kRings; ++r) {
    const double angle = kPi * (r + 0.25) / (kRings - 0.5);
    std::vector<Vector3d> ring;
    for (int s = 0; s < kSides; ++s) {
      const double around = 2.0 * kPi * s / kSides;
      const double bulge = radius * std::sin(angle) * random->uniform(0.8, 1.15);
      ring.emplace_back(bulge * std::cos(around), bulge * std::sin(around),
                        foot + 0.5 * height * (1.0 - std::cos(angle)) + random->uniform(-0.1, 0.1));
    }
    rings.push_back(ring);
  }
  for (std::size_t r = 0; r + 1 < rings.size(); ++r) {
    for (std::size_t s = 0; s < kSides; ++s) {
      const std::size_t next = (s + 1) % kSides;
      const Material leaves =
          makeMaterial(Pattern::kLeaves, random->uniform(0.2, 0.34), 0.75, random);
      builder->addPolygon({rings[r][s], rings[r][next], rings[r + 1][next]}, leaves);
      builder->addPolygon({rings[r][s], rings[r + 1][next], rings[r + 1][s]}, leaves);
    }
  }
  const Vector3d apex(0.0, 0.0, foot + height);
  for (std::size_t s = 0; s < kSides; ++s) {
    builder->addPolygon({rings.back()[s], rings.back()[(s + 1) % kSides], apex},
                        makeMaterial(Pattern::kLeaves, 0.3, 0.75, random));
  }
}

void addWheel(const Vector3d& centre, double side, double radius, const Material& material,
              ObjectBuilder* builder) {
  std::vector<Vector3d> corners;
  for (int i = 0; i < 8; ++i) {
    const double angle = -side * 2.0 * kPi * i / 8.0;
    corners.push_back(centre + radius * Vector3d(std::cos(angle), 0.0, std::sin(angle)));
  }
  builder->addPolygon(corners, material);
}

}  // namespace

Object makeTree(Random* random) {
  ObjectBuilder builder;
  const double trunk = random->uniform(1.8, 2.8);
  const double thickness = random->uniform(0.12, 0.22);
  builder.addColumn(Vector3d::Zero(), trunk + 0.5, thickness, 0.1,
                    makeMaterial(Pattern::kRough, 0.25, 0.4, random));
  const double radius = random->uniform(1.3, 2.2);
  addCrown(trunk, radius, random->uniform(2.5, 4.5), random, &builder);
  return builder.take(kDrawTrees);
}

Object makeCar(Random* random) {
  ObjectBuilder builder;
  const double length = random->uniform(3.7, 4.8);
  const double width = random->uniform(1.65, 1.85);
  const double belt = random->uniform(0.85, 1.0);
  const double roof = belt + random->uniform(0.5, 0.75);
  const double tones[] = {0.06, 0.15, 0.3, 0.5, 0.8};
  const double tone = tones[random->integer(0, 4)];
  const Vector2d doors{random->uniform(0.95, 1.2), 0.42};
  const Material body = makeMaterial(Pattern::kPanels, tone, 0.12, doors, random);
  const Material windows = makeMaterial(Pattern::kPanels, 0.14, 0.5, {0.85, 1.0}, random);
  const auto at = [](double x, double y, double z) { return uprightPose({x, y, z}, 0.0); };
  builder.addBox({at(0.0, 0.0, 0.22), {length, width, belt - 0.22}}, body);
  builder.addTaperedBox({at(-0.08 * length, 0.0, belt), {0.62 * length, width - 0.06, roof - belt}},
                        {random->uniform(0.3, 0.55), 0.14}, windows, body);
  const Material tyre = makeMaterial(Pattern::kRough, 0.07, 0.3, random);
  const Material rim = makeMaterial(Pattern::kPicture, 0.5, 0.5, {0.4, 0.4}, random);
  for (const double x : {-0.31 * length, 0.31 * length}) {
    for (const double side : {-1.0, 1.0}) {
      addWheel({x, side * (0.5 * width + 0.012), 0.31}, side, 0.31, tyre, &builder);
      addWheel({x, side * (0.5 * width + 0.02), 0.31}, side, 0.19, rim, &builder);
    }
  }
  const Material lamp = makeMaterial(Pattern::kPlain, 0.9, 0.1, random);
  const Material rear = makeMaterial(Pattern::kPlain, 0.25, 0.1, random);
  const Material plate = makeMaterial(Pattern::kPicture, 0.6, 0.7, {0.5, 0.11}, random);
  for (const double y : {-0.36 * width, 0.36 * width}) {
    builder.addBox({at(0.5 * length, y, 0.6), {0.03, 0.3, 0.16}}, lamp);
    builder.addBox({at(-0.5 * length, y, 0.65), {0.03, 0.25, 0.2}}, rear);
  }
  builder.addBox({at(0.5 * length, 0.0, 0.4), {0.03, 0.5, 0.11}}, plate);
  builder.addBox({at(-0.5 * length, 0.0, 0.5), {0.03, 0.5, 0.11}}, plate);
  return builder.take(kDrawCars);
}

}  // namespace point_line_odometry::world
