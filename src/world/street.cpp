#include "world/street.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "world/random.h"
#include "world/scene.h"
#include "world/street_objects.h"
#include "world/street_route.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// The town is a grid of blocks; measures in metres.
constexpr double kBlockPitch = 72.0;
constexpr double kRoadWidth = 12.0;
constexpr double kPavementWidth = 3.2;
constexpr double kKerbHeight = 0.14;
constexpr double kLaneOffset = 1.9;  // of a lane's middle from the middle of the road
constexpr double kParkingOffset = 4.9;
constexpr double kSlab = kBlockPitch - kRoadWidth;      // a block with its pavement
constexpr double kLots = kSlab - 2.0 * kPavementWidth;  // area of the houses
constexpr double kLotDepth = 10.0;
constexpr int kMargin = 2;  // blocks around the trajectory

// With a hill: start of the road over it, and of the town [blocks].
constexpr int kOutside = 4;
constexpr int kTownBegins = 2;
constexpr double kHillHeight = 7.0;  // slopes of up to 15 %
constexpr double kBeforeHill = 48.0;

// Largest distance at which details are drawn.
constexpr double kDrawDetails = 130.0;

/// Builds the objects of a town.
class Town {
 public:
  Town(std::uint32_t seed, Scene* scene) : random_(hash(seed, 1)), scene_(*scene) {
    makeCars();
    makeTrees();
  }

  void addGround(const Vector2d& low, const Vector2d& high) {
    ObjectBuilder builder;
    constexpr double kBeyond = 900.0;
    const Vector3d corner(low.x() - kBeyond, low.y() - kBeyond, 0.0);
    const Vector2d size = high - low + Vector2d::Constant(2.0 * kBeyond);
    builder.addRectangle(corner, Vector3d(size.x(), 0.0, 0.0), Vector3d(0.0, size.y(), 0.0),
                         makeMaterial(Pattern::kRough, 0.30, 0.22, &random_));
    scene_.place(builder.take());
  }

  /// The block whose lower corner, in the middle of the crossing, is (i, j) pitches from the
  /// origin.
  void addBlock(int i, int j) {
    const Vector3d centre((i + 0.5) * kBlockPitch, (j + 0.5) * kBlockPitch, 0.0);
    addSlab(centre);
    for (int side = 0; side < 4; ++side) {
      const Eigen::Isometry3d T_world_side = uprightPose(centre, 0.5 * kPi * side);
      addHouses(T_world_side, side % 2 == 0);
      addPavement(T_world_side);
      addParkedCars(T_world_side);
      addMarkings(T_world_side, side < 2);
    }
  }

  /// A block of open country: grass, trees here and there, at times a fence along the road.
  void addMeadow(int i, int j) {
    const Vector3d centre((i + 0.5) * kBlockPitch, (j + 0.5) * kBlockPitch, 0.0);
    ObjectBuilder builder;
    constexpr double kHeight = 0.02;
    builder.addRectangle(centre + Vector3d(-0.5 * kSlab, -0.5 * kSlab, kHeight),
                         Vector3d(kSlab, 0.0, 0.0), Vector3d(0.0, kSlab, 0.0),
                         makeMaterial(Pattern::kRough, 0.25, 0.35, &random_));
    scene_.place(builder.take());
    for (int trees = random_.integer(0, 3); trees > 0; --trees) {
      const double y = random_.uniform(-0.45, 0.45) * kSlab;
      const double x = random_.uniform(-0.45, 0.45) * kSlab;
      addTree(centre + Vector3d(x, y, kHeight));
    }
    for (int side = 0; side < 4; ++side) {
      const Eigen::Isometry3d T_world_side = uprightPose(centre, 0.5 * kPi * side);
      if (random_.chance(0.3)) addFence(T_world_side);
      addMarkings(T_world_side, side < 2);
    }
  }

  std::size_t anyCar() {
    return cars_[static_cast<std::size_t>(random_.integer(0, static_cast<int>(cars_.size()) - 1))];
  }

  Random& random() { return random_; }

 private:
  void addSlab(const Vector3d& centre) {
    ObjectBuilder builder;
    const Material kerb = makeMaterial(Pattern::kTiles, 0.55, 0.25, {1.0, 0.5}, &random_);
    const Material paving = makeMaterial(Pattern::kTiles, 0.45, 0.25, {0.5, 0.5}, &random_);
    builder.addBox({uprightPose(centre, 0.0), {kSlab, kSlab, kKerbHeight}}, kerb, paving);
    scene_.place(builder.take());
  }

  /// Posts along one side of a meadow.
  void addFence(const Eigen::Isometry3d& T_world_side) {
    ObjectBuilder builder;
    const Material wood = makeMaterial(Pattern::kRough, 0.35, 0.2, &random_);
    for (double x = -0.5 * kSlab + 2.0; x < 0.5 * kSlab - 2.0; x += 4.0) {
      builder.addColumn(T_world_side * Vector3d(x, -0.5 * kSlab + 3.0, 0.0), 1.1, 0.05, 0.05, wood);
    }
    scene_.place(builder.take(kDrawDetails));
  }

  /// Houses along one side of a block. In the frame of a side x runs along the pavement to the
  /// right as seen from the road, y away from the road; the road is at negative y.
  void addHouses(const Eigen::Isometry3d& T_world_side, bool to_the_corners) {
    const double half = 0.5 * kLots - (to_the_corners ? 0.0 : kLotDepth);
    double x = -half;
    while (x < half - 1.0) {
      double width = random_.uniform(7.5, 14.0);
      if (half - x - width < 7.5) width = half - x;
      if (random_.chance(0.12)) {
        addGarden(T_world_side, x, width);
      } else {
        addHouse(T_world_side, x, width);
      }
      x += width;
    }
  }

  void addGarden(const Eigen::Isometry3d& T_world_side, double x, double width) {
    ObjectBuilder builder;
    const bool hedge = random_.chance(0.5);
    const Material material =
        hedge ? makeMaterial(Pattern::kLeaves, 0.25, 0.7, &random_)
              : makeMaterial(Pattern::kBricks, 0.4, 0.3, {0.25, 0.08}, &random_);
    const Vector3d wall_position(x + 0.5 * width, -0.5 * kLots + 0.3, kKerbHeight);
    builder.addBox(
        {T_world_side * uprightPose(wall_position, 0.0), {width, 0.4, random_.uniform(1.0, 2.2)}},
        material);
    scene_.place(builder.take());
    addTree(T_world_side * Vector3d(x + 0.5 * width, -0.5 * kLots + 4.0, kKerbHeight));
  }

  Material wallOfHouse() {
    const double albedo = random_.uniform(0.3, 0.75);
    if (random_.chance(0.45)) {
      return makeMaterial(Pattern::kBricks, 0.75 * albedo, 0.35,
                          {random_.uniform(0.2, 0.3), random_.uniform(0.065, 0.1)}, &random_);
    }
    return makeMaterial(Pattern::kRough, albedo, random_.uniform(0.08, 0.2), &random_);
  }

  void addHouse(const Eigen::Isometry3d& T_world_side, double x, double width) {
    const int floors = random_.integer(2, 4);
    const double floor_height = random_.uniform(2.8, 3.4);
    const double height = floors * floor_height + 0.4;
    const double setback = random_.uniform(0.0, 0.8);
    const Vector3d size(width - 0.02, kLotDepth - setback, height);
    const Eigen::Isometry3d pose =
        T_world_side *
        uprightPose(Vector3d(x + 0.5 * width, -0.5 * kLots + setback + 0.5 * size.y(), kKerbHeight),
                    0.0);
    Material front = wallOfHouse();
    const int columns = std::max(2, static_cast<int>(width / random_.uniform(2.3, 3.2)));
    front.windows.pitch_u = static_cast<float>(size.x() / columns);
    front.windows.pitch_v = static_cast<float>(floor_height);
    front.windows.width = front.windows.pitch_u * static_cast<float>(random_.uniform(0.35, 0.6));
    front.windows.height = static_cast<float>(random_.uniform(1.2, 1.7));
    front.windows.recess = static_cast<float>(random_.uniform(0.06, 0.22));
    Material side = front;
    side.windows.pitch_u = static_cast<float>(size.y() / 2.0);

    ObjectBuilder builder;
    const Vector3d corner = pose * Vector3d(-0.5 * size.x(), -0.5 * size.y(), 0.0);
    const Eigen::Matrix3d& axes = pose.linear();
    const Vector3d along = axes.col(0) * size.x();
    const Vector3d inward = axes.col(1) * size.y();
    const Vector3d up(0.0, 0.0, height);
    builder.addRectangle(corner, along, up, front);
    builder.addRectangle(corner + along, inward, up, side);
    builder.addRectangle(corner + inward, -inward, up, side);
    addRoof(pose, size, &builder);
    scene_.place(builder.take());
    addDetails(pose, size, floor_height, front);
  }

  void addRoof(const Eigen::Isometry3d& pose, const Vector3d& size, ObjectBuilder* builder) {
    const Material tiles =
        makeMaterial(Pattern::kTiles, random_.uniform(0.15, 0.4), 0.3, {0.3, 0.35}, &random_);
    constexpr double kEaves = 0.35;
    const double x = 0.5 * size.x();
    const double y = 0.5 * size.y() + kEaves;
    const double rise = random_.uniform(1.8, 4.0);
    const auto at = [&](double px, double py, double pz) -> Vector3d {
      return pose * Vector3d(px, py, size.z() + pz);
    };
    builder->addPolygon({at(-x, -y, -0.1), at(x, -y, -0.1), at(x, 0.0, rise), at(-x, 0.0, rise)},
                        tiles);
    builder->addPolygon({at(x, y, -0.1), at(-x, y, -0.1), at(-x, 0.0, rise), at(x, 0.0, rise)},
                        tiles);
    const Material gable = makeMaterial(Pattern::kRough, 0.5, 0.15, &random_);
    builder->addPolygon({at(x, -y, -0.1), at(x, y, -0.1), at(x, 0.0, rise)}, gable);
    builder->addPolygon({at(-x, y, -0.1), at(-x, -y, -0.1), at(-x, 0.0, rise)}, gable);
    const Material plaster = makeMaterial(Pattern::kPlain, 0.75, 0.05, &random_);
    const Vector3d eaves(0.0, -0.5 * size.y() - 0.5 * kEaves, size.z() - 0.2);
    builder->addBox({pose * uprightPose(eaves, 0.0), {size.x(), kEaves, 0.12}}, plaster);
    if (random_.chance(0.7)) {
      const Vector3d chimney(random_.uniform(-0.35, 0.35) * size.x(), -0.2 * size.y(),
                             size.z() + 0.4 * rise);
      builder->addBox({pose * uprightPose(chimney, 0.0), {0.7, 0.6, 0.6 * rise + 0.5}},
                      makeMaterial(Pattern::kBricks, 0.3, 0.3, {0.25, 0.08}, &random_));
    }
  }

  /// Doors, sills, cornices, drain pipes and balconies of a front.
  void addDetails(const Eigen::Isometry3d& pose, const Vector3d& size, double floor_height,
                  const Material& front) {
    ObjectBuilder builder;
    const double y = -0.5 * size.y();
    const auto add = [&](const Vector3d& foot, const Vector3d& box, const Material& material) {
      builder.addBox({pose * uprightPose(foot + Vector3d(0.0, y, 0.0), 0.0), box}, material);
    };
    const Material stone = makeMaterial(Pattern::kRough, 0.7, 0.1, &random_);
    const Windows& w = front.windows;
    const int columns = static_cast<int>(std::lround(size.x() / w.pitch_u));
    const int door = random_.integer(0, columns - 1);
    const auto middle = [&](int column) { return -0.5 * size.x() + (column + 0.5) * w.pitch_u; };
    add({middle(door), -0.06, 0.0}, {1.25, 0.12, 2.35}, stone);
    add({middle(door), -0.10, 0.0}, {1.0, 0.06, 2.2},
        makeMaterial(Pattern::kPanels, random_.uniform(0.1, 0.6), 0.1, {0.5, 0.72}, &random_));
    add({middle(door), -0.4, 2.45}, {1.5, 0.8, 0.1}, stone);
    for (double z = w.sill - 0.08; z < size.z() - 1.0; z += floor_height) {
      for (int c = 0; c < columns; ++c) {
        if (c == door && z < 2.0) continue;
        add({middle(c), -0.07, z}, {w.width + 0.2, 0.14, 0.08}, stone);
      }
    }
    add({0.0, -0.06, floor_height - 0.2}, {size.x(), 0.12, 0.18}, stone);
    add({0.5 * size.x() - 0.12, -0.07, 0.0}, {0.1, 0.1, size.z() - 0.3},
        makeMaterial(Pattern::kPlain, random_.uniform(0.15, 0.6), 0.05, &random_));
    if (random_.chance(0.35)) {
      const int column = random_.integer(0, columns - 1);
      add({middle(column), -0.6, floor_height + 0.1}, {w.pitch_u * 0.8, 1.2, 0.15}, stone);
      add({middle(column), -1.17, floor_height + 0.25}, {w.pitch_u * 0.8, 0.06, 0.95},
          makeMaterial(Pattern::kPanels, 0.25, 0.05, {0.12, 2.0}, &random_));
    }
    if (random_.chance(0.3)) {
      const Vector2d board{random_.uniform(1.5, 3.0), 0.6};
      const double x = random_.uniform(-0.2, 0.2) * size.x();
      add({x, -0.12, floor_height + 0.15}, {board.x(), 0.1, board.y()},
          makeMaterial(Pattern::kPicture, 0.5, 0.6, board, &random_));
    }
    scene_.place(builder.take(kDrawDetails));
  }

  /// Lamp posts, signs, trees, bins and boxes along one side.
  void addPavement(const Eigen::Isometry3d& T_world_side) {
    const double edge = -0.5 * kSlab + 0.55;
    const Material metal = makeMaterial(Pattern::kPlain, random_.uniform(0.2, 0.5), 0.1, &random_);
    for (double x = -0.5 * kSlab + random_.uniform(3.0, 6.0); x < 0.5 * kSlab - 2.0;
         x += random_.uniform(5.0, 9.0)) {
      const Vector3d foot(x, edge, kKerbHeight);
      ObjectBuilder builder;
      switch (random_.integer(0, 5)) {
        case 0:
          builder.addColumn(T_world_side * foot, 5.5, 0.09, 0.05, metal);
          builder.addBox(
              {T_world_side * uprightPose(foot + Vector3d(0.0, -0.6, 5.4), 0.0), {0.16, 1.4, 0.12}},
              metal);
          break;
        case 1:
          addSign(T_world_side, foot, metal, &builder);
          break;
        case 2:
        case 3:
          addTree(T_world_side * foot);
          break;
        case 4: {
          const Vector3d box{random_.uniform(0.5, 1.2), 0.4, random_.uniform(0.9, 1.4)};
          const double yaw = random_.uniform(-0.1, 0.1);
          builder.addBox(
              {T_world_side * uprightPose(foot, yaw), box},
              makeMaterial(Pattern::kPanels, random_.uniform(0.2, 0.7), 0.1, {0.5, 0.6}, &random_));
          break;
        }
        default:
          builder.addColumn(T_world_side * foot, random_.uniform(0.7, 1.0), 0.07, 0.07, metal);
      }
      Object object = builder.take(kDrawDetails);
      if (!object.surfaces.empty()) scene_.place(std::move(object));
    }
  }

  void addSign(const Eigen::Isometry3d& T_world_side, const Vector3d& foot, const Material& metal,
               ObjectBuilder* builder) {
    builder->addColumn(T_world_side * foot, 2.9, 0.035, 0.035, metal);
    const double size = random_.uniform(0.5, 0.8);
    // Facing along the road, visible from both sides.
    const Vector3d sign_position = foot + Vector3d(-0.06, 0.0, 2.1);
    builder->addBox({T_world_side * uprightPose(sign_position, 0.0), {0.03, size, size}},
                    makeMaterial(Pattern::kPicture, 0.5, 0.7, {size, size}, &random_), metal);
  }

  void addParkedCars(const Eigen::Isometry3d& T_world_side) {
    const double y = -0.5 * kBlockPitch + kParkingOffset;
    double x = -0.5 * kSlab + 6.0;
    while (x < 0.5 * kSlab - 6.0) {
      if (random_.chance(0.55)) {
        const Vector3d spot(x, y + random_.uniform(-0.15, 0.1), 0.0);
        double yaw = random_.chance(0.2) ? 0.0 : kPi;
        yaw += random_.uniform(-0.03, 0.03);
        scene_.instances.push_back({anyCar(), T_world_side * uprightPose(spot, yaw)});
      }
      x += random_.uniform(5.6, 7.5);
    }
  }

  /// Dashes in the middle of the road and a crossing for pedestrians.
  void addMarkings(const Eigen::Isometry3d& T_world_side, bool middle_line) {
    ObjectBuilder builder;
    const Material paint = makeMaterial(Pattern::kRough, 0.75, 0.12, &random_);
    constexpr double kHeight = 0.004;
    const auto add = [&](double x, double y, double length, double width) {
      builder.addRectangle(T_world_side * Vector3d(x, y, kHeight),
                           T_world_side.linear() * Vector3d(length, 0.0, 0.0),
                           T_world_side.linear() * Vector3d(0.0, width, 0.0), paint);
    };
    const double road = -0.5 * kBlockPitch;
    if (middle_line) {
      for (double x = -0.5 * kSlab + 6.0; x < 0.5 * kSlab - 8.0; x += 7.5) {
        add(x, road - 0.06, 3.0, 0.12);
      }
    }
    // Half of a zebra crossing at one end of this side's half of the road.
    if (random_.chance(0.5)) {
      for (double y = 0.4; y < 0.5 * kRoadWidth - 0.5; y += 1.0) {
        add(0.5 * kSlab - 5.0, road + y, 3.0, 0.5);
      }
    }
    scene_.place(builder.take());
  }

  void addTree(const Vector3d& foot) {
    const auto kind =
        static_cast<std::size_t>(random_.integer(0, static_cast<int>(trees_.size()) - 1));
    scene_.instances.push_back({trees_[kind], uprightPose(foot, random_.uniform(0.0, 2.0 * kPi))});
  }

  void makeTrees() {
    constexpr int kKinds = 12;
    for (int i = 0; i < kKinds; ++i) trees_.push_back(scene_.add(makeTree(&random_)));
  }

  void makeCars() {
    constexpr int kKinds = 14;
    for (int i = 0; i < kKinds; ++i) cars_.push_back(scene_.add(makeCar(&random_)));
  }

  Random random_;
  Scene& scene_;
  std::vector<std::size_t> cars_;
  std::vector<std::size_t> trees_;
};

/// True if a block is a meadow. Uses a separate random number, so that the rest of the town
/// does not depend on `share`.
bool isOpenCountry(std::uint32_t seed, int i, int j, double share) {
  const auto index = static_cast<std::uint32_t>(1000 * (i + kMargin) + j + kMargin);
  return Random(hash(seed, 4, index)).chance(share);
}

/// True if the hill replaces this block.
bool isReplacedByHill(int i, int j) { return i >= -kOutside && i < 0 && (j == -1 || j == 0); }

/// The blocks between two corners, with the open country around a hill.
void addBlocks(const Vector2d& low, const Vector2d& high, std::uint32_t seed,
               const StreetOptions& options, Town* town) {
  const bool hilly = options.hill > 0.0;
  for (int i = static_cast<int>(low.x()); i < static_cast<int>(high.x()); ++i) {
    for (int j = static_cast<int>(low.y()); j < static_cast<int>(high.y()); ++j) {
      if (hilly && isReplacedByHill(i, j)) continue;
      if ((hilly && i < kTownBegins) || isOpenCountry(seed, i, j, options.open_country)) {
        town->addMeadow(i, j);
      } else {
        town->addBlock(i, j);
      }
    }
  }
}

void addMovingCars(int count, Town* town, Scene* scene) {
  for (int i = 0; i < count; ++i) {
    Mover mover;
    mover.object = town->anyCar();
    const bool oncoming = i % 3 != 2;
    mover.to_the_left_m = oncoming ? 2.0 * kLaneOffset : 0.0;
    mover.speed_m_s = oncoming ? -town->random().uniform(6.0, 11.0) : 7.0;
    mover.start_m = oncoming ? 40.0 * (i + 1) : 9.0 + 5.0 * i;
    if (!oncoming) mover.least_gap_m = 8.0 + 4.0 * i;  // the camera would drive through it
    scene->movers.push_back(mover);
  }
}

}  // namespace

Scene makeStreet(std::uint32_t seed, const StreetOptions& options) {
  constexpr double kCameraHeight = 1.65;
  const bool hilly = options.hill > 0.0;
  Scene scene;
  scene.seed = hash(seed, 2);
  scene.haze_m = 500.0;
  scene.lighting = {Vector3d(0.45, -0.55, 0.7).normalized(), 0.62, 0.55};
  Town town(seed, &scene);

  std::vector<Vector2d> crossings = hilly ? chooseCrossingsFromOutside(kOutside, &town.random())
                                          : chooseCrossings(&town.random());
  Vector2d high = Vector2d::Zero();
  for (const Vector2d& crossing : crossings) high = high.cwiseMax(crossing);
  const Vector2d low(hilly ? -kOutside : 0, 0.0);
  const Vector2d margin = Vector2d::Constant(kMargin);
  addBlocks(low - margin, high + margin, seed, options, &town);
  town.addGround((low - margin) * kBlockPitch, (high + margin) * kBlockPitch);

  for (Vector2d& crossing : crossings) crossing *= kBlockPitch;
  std::vector<Vector3d> corners = toTheRight(crossings, kLaneOffset, kCameraHeight);
  MotionStyle style;
  style.cruise_m_s = 12.0;
  style.lateral_m_s2 = 3.0;
  style.longitudinal_m_s2 = 2.0;
  style.sway_m = {0.0, 0.02, 0.02};
  style.sway_rad = Vector3d(0.35, 0.35, 0.3) * kPi / 180.0;
  style.sway_hz = 0.7;
  if (hilly) {
    const Vector2d range_x(-kOutside * kBlockPitch + 0.5 * kRoadWidth, -0.5 * kRoadWidth);
    scene.hill.height_m = options.hill * kHillHeight;
    scene.hill.middle_x = crossings[0].x() + kBeforeHill + scene.hill.half_length_m;
    addHill(scene.hill, range_x, kRoadWidth, &town.random(), &scene);
    corners = overTheHill(corners, scene.hill);
    style.follows_slope = true;
    scene.clouds = 1.0;
  }
  constexpr double kTurn_m = 14.0;
  scene.trajectory = CameraTrajectory(corners, kTurn_m, style, hash(seed, 3));
  addMovingCars(options.moving_objects, &town, &scene);
  return scene;
}

}  // namespace point_line_odometry::world
