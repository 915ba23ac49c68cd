#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace point_line_odometry::world {

class Random;

/// Procedural texture of a surface. All patterns are functions of the position on the surface [m]
/// and of a seed, so that they need no memory and do not repeat.
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
  bool shines = false;  ///< a lamp or screen: its brightness does not depend on the light
  Windows windows;
};

/// A material with a random seed.
Material makeMaterial(Pattern pattern, double albedo, double contrast, Random* random);

/// A material with a pattern of a size [m].
Material makeMaterial(Pattern pattern, double albedo, double contrast, const Eigen::Vector2d& size,
                      Random* random);

/// The patch of a surface that a pixel sees.
struct Patch {
  float u = 0.0F;  ///< centre [m]
  float v = 0.0F;
  float size_u = 0.0F;  ///< extent [m]; structures that are smaller fade to their mean
  float size_v = 0.0F;
  float slope_u = 0.0F;  ///< sideways shift of the ray per metre behind the surface
  float slope_v = 0.0F;
};

/// Mean share of the light that the patch reflects.
float reflectance(const Material& material, const Patch& patch);

/// Brightness of the sky in a direction (z up) of any length.
/// \param clouds contrast of clouds on a darker sky, 0 ... 1; 0: bright mist.
float skyRadiance(std::uint32_t seed, float clouds, float x, float y, float z);

}  // namespace point_line_odometry::world
