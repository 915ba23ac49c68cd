#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "world/batch.h"

namespace point_line_odometry::world {

class Random;

/// Procedural texture of a surface. All patterns are functions of the position on the surface [m]
/// and of a seed, so that they need no memory and repeat only where they are to.
enum class Pattern : std::uint8_t {
  kPlain,    ///< one tone, with a soft drift of contrast * albedo over metres
  kRough,    ///< stains, patches and grains of every size: asphalt, plaster, stone
  kBricks,   ///< courses of bricks, every one of its own tone
  kTiles,    ///< a grid of joints and tiles of different tone: paving, floors, roofs
  kPanels,   ///< a grid of grooves in a plain tone: doors, car bodies, ceilings
  kPicture,  ///< shapes and lettering of strong contrast: posters, signs, screens
  kShelf,    ///< boards with books of many widths, heights and tones
  kLeaves,   ///< foliage
  kSpots,    ///< soft round spots of 3 to 20 cm: plaster, concrete, carpet
};

/// Rows of recessed windows in a wall [m].
struct Windows {
  float pitch_u = 0.0F;  ///< 0: the wall has none
  float pitch_v = 3.0F;
  float width = 1.2F;
  float height = 1.4F;
  float sill = 0.9F;     ///< height of the lower edge above each floor
  float recess = 0.15F;  ///< depth of the glass behind the wall
};

struct Material {
  Pattern pattern = Pattern::kPlain;
  float albedo = 0.5F;    ///< mean share of the light that is reflected
  float contrast = 0.1F;  ///< of the pattern, relative to albedo
  float size_u = 0.25F;   ///< of a brick, tile, panel or picture [m]
  float size_v = 0.08F;
  std::uint32_t seed = 0;
  bool shines = false;      ///< a lamp or screen: its brightness does not depend on the light
  float repetition = 0.0F;  ///< the pattern repeats after this length, in u and v; 0: never [m]
  Windows windows;
};

/// A material with a random seed.
Material makeMaterial(Pattern pattern, double albedo, double contrast, Random* random);

/// A material with a pattern of a size [m].
Material makeMaterial(Pattern pattern, double albedo, double contrast, const Eigen::Vector2d& size,
                      Random* random);

/// Mean share of the light that each patch reflects.
void reflectance(const Material& material, const PatchBatch& patches, Values* out);

}  // namespace point_line_odometry::world
