#include "world/material.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "world/random.h"

namespace point_line_odometry::world {
namespace {

int floorToInt(float x) {
  const int i = static_cast<int>(x);
  return i - static_cast<int>(x < static_cast<float>(i));
}

std::uint32_t cellHash(std::uint32_t seed, int iu, int iv) {
  return hash(seed, static_cast<std::uint32_t>(iu), static_cast<std::uint32_t>(iv));
}

float clampUnit(float x) { return std::min(1.0F, std::max(0.0F, x)); }

float blend(float a, float b, float share) { return a + (b - a) * share; }

/// Remaining contrast of structures of a size after averaging over a window of another size.
float visibility(float structure, float window) { return clampUnit(1.5F - window / structure); }

/// Length of the window [x - size / 2, x + size / 2] that lies in [begin, end], at most 0 for none.
float overlap(float x, float size, float begin, float end) {
  return std::min(x + 0.5F * size, end) - std::max(x - 0.5F * size, begin);
}

/// Share of the window [x - size / 2, x + size / 2] that lies in [begin, end].
float coverage(float x, float size, float begin, float end) {
  return clampUnit(overlap(x, size, begin, end) / size);
}

/// Share of the window that lies in the interval [begin, end] of any period.
float periodicCoverage(float x, float size, float period, float begin, float end) {
  const float phase = x - period * static_cast<float>(floorToInt(x / period));
  const auto covered = [=](float to) {
    const auto whole = static_cast<float>(floorToInt(to / period));
    return whole * (end - begin) +
           std::min(end - begin, std::max(0.0F, to - whole * period - begin));
  };
  return clampUnit((covered(phase + 0.5F * size) - covered(phase - 0.5F * size)) / size);
}

/// Smooth noise in [-1, 1] with knots at whole numbers.
float smoothNoise(float x, float y, std::uint32_t seed) {
  const int ix = floorToInt(x);
  const int iy = floorToInt(y);
  float fx = x - static_cast<float>(ix);
  float fy = y - static_cast<float>(iy);
  fx = fx * fx * (3.0F - 2.0F * fx);
  fy = fy * fy * (3.0F - 2.0F * fy);
  const auto knot = [=](int dx, int dy) {
    return static_cast<float>(cellHash(seed, ix + dx, iy + dy) >> 8) * 0x1p-23F - 1.0F;
  };
  return blend(blend(knot(0, 0), knot(1, 0), fx), blend(knot(0, 1), knot(1, 1), fx), fy);
}

float noise(const Patch& p, float size, std::uint32_t seed) {
  const float seen = visibility(size, p.size_u) * visibility(size, p.size_v);
  return seen > 0.0F ? seen * smoothNoise(p.u / size, p.v / size, seed) : 0.0F;
}

/// Cells of a grid of size 1 that a window touches along one axis.
struct CellRange {
  int first;
  int last;

  CellRange(float x, float size)
      : first(floorToInt(x - 0.5F * size)), last(floorToInt(x + 0.5F * size)) {}
};

/// Area of the patch that the rectangle of a cell covers, times its tone.
float fleck(const Patch& p, int ix, int iy, std::uint32_t seed) {
  const std::uint32_t h = cellHash(seed, ix, iy);
  const float left = static_cast<float>(ix) + 0.05F + 0.45F * unit(h, 0);
  const float width = overlap(p.u, p.size_u, left, left + 0.12F + 0.36F * unit(h, 2));
  if (width <= 0.0F) return 0.0F;
  const float low = static_cast<float>(iy) + 0.05F + 0.45F * unit(h, 1);
  const float height = overlap(p.v, p.size_v, low, low + 0.12F + 0.36F * unit(h, 3));
  if (height <= 0.0F) return 0.0F;
  return width * height * (2.0F * unit(mix(h), 0) - 1.0F);
}

/// Rectangles with sharp edges, one in every cell of the size, of a tone in [-1, 1].
float flecks(const Patch& p, float size, std::uint32_t seed) {
  const float scale = 1.0F / size;
  const Patch in_cells{p.u * scale, p.v * scale, p.size_u * scale, p.size_v * scale, 0.0F, 0.0F};
  const float seen = visibility(1.0F, in_cells.size_u) * visibility(1.0F, in_cells.size_v);
  if (seen <= 0.0F) return 0.0F;
  const CellRange columns(in_cells.u, in_cells.size_u);
  const CellRange rows(in_cells.v, in_cells.size_v);
  float sum = 0.0F;
  for (int iy = rows.first; iy <= rows.last; ++iy) {
    for (int ix = columns.first; ix <= columns.last; ++ix) sum += fleck(in_cells, ix, iy, seed);
  }
  return sum != 0.0F ? seen * sum / (in_cells.size_u * in_cells.size_v) : 0.0F;
}

/// Stains and grains of all sizes, in about [-1, 1].
float roughness(const Patch& p, std::uint32_t seed) {
  float sum = 0.30F * noise(p, 1.7F, seed) + 0.30F * noise(p, 0.31F, seed + 1) +
              0.30F * noise(p, 0.06F, seed + 2) + 0.30F * noise(p, 0.015F, seed + 3);
  sum += 0.7F * flecks(p, 2.3F, seed + 4) + 0.8F * flecks(p, 0.5F, seed + 5) +
         0.8F * flecks(p, 0.11F, seed + 6) + 0.8F * flecks(p, 0.03F, seed + 7);
  return sum;
}

/// A random tone in [-1, 1] for every cell of a grid.
float cellTone(const Patch& p, float size_u, float size_v, float offset, std::uint32_t seed) {
  const float seen = visibility(size_u, p.size_u) * visibility(size_v, p.size_v);
  if (seen <= 0.0F) return 0.0F;
  const Patch in_cells{(p.u + offset) / size_u, p.v / size_v, p.size_u / size_u,
                       p.size_v / size_v,       0.0F,         0.0F};
  const CellRange columns(in_cells.u, in_cells.size_u);
  const CellRange rows(in_cells.v, in_cells.size_v);
  float sum = 0.0F;
  for (int iy = rows.first; iy <= rows.last; ++iy) {
    const auto low = static_cast<float>(iy);
    const float in_row = coverage(in_cells.v, in_cells.size_v, low, low + 1.0F);
    for (int ix = columns.first; ix <= columns.last; ++ix) {
      const auto left = static_cast<float>(ix);
      const float in_column = coverage(in_cells.u, in_cells.size_u, left, left + 1.0F);
      sum += in_row * in_column * (2.0F * unit(cellHash(seed, ix, iy), 0) - 1.0F);
    }
  }
  return seen * sum;
}

float rough(const Material& m, const Patch& p) {
  return m.albedo * (1.0F + m.contrast * roughness(p, m.seed));
}

float plain(const Material& m, const Patch& p) {
  return m.albedo * (1.0F + m.contrast * noise(p, 2.7F, m.seed));
}

float bricks(const Material& m, const Patch& p) {
  constexpr float kJoint = 0.012F;
  const int course = floorToInt(p.v / m.size_v);
  const float offset = (course & 1) != 0 ? 0.5F * m.size_u : 0.0F;
  const float brick = periodicCoverage(p.u + offset, p.size_u, m.size_u, kJoint, m.size_u) *
                      periodicCoverage(p.v, p.size_v, m.size_v, kJoint, m.size_v);
  const float tone =
      0.8F * cellTone(p, m.size_u, m.size_v, offset, m.seed) + 0.5F * roughness(p, m.seed + 100);
  const float joint = std::min(0.9F, 1.35F * m.albedo);
  return blend(joint, m.albedo * (1.0F + m.contrast * tone), brick);
}

float tiles(const Material& m, const Patch& p) {
  const float joint_u = std::min(0.012F, 0.1F * m.size_u);
  const float joint_v = std::min(0.012F, 0.1F * m.size_v);
  const float tile = periodicCoverage(p.u, p.size_u, m.size_u, joint_u, m.size_u) *
                     periodicCoverage(p.v, p.size_v, m.size_v, joint_v, m.size_v);
  const float tone =
      0.7F * cellTone(p, m.size_u, m.size_v, 0.0F, m.seed) + 0.5F * roughness(p, m.seed + 100);
  return blend(0.55F * m.albedo, m.albedo * (1.0F + m.contrast * tone), tile);
}

float panels(const Material& m, const Patch& p) {
  constexpr float kGroove = 0.014F;
  const float panel = periodicCoverage(p.u, p.size_u, m.size_u, kGroove, m.size_u) *
                      periodicCoverage(p.v, p.size_v, m.size_v, kGroove, m.size_v);
  return plain(m, p) * blend(0.45F, 1.0F, panel);
}

/// Shapes over a background, and rows of letters.
float picture(const Material& m, const Patch& p) {
  const float scale = std::min(m.size_u, m.size_v);
  const float border = std::min(coverage(p.u, p.size_u, 0.04F * scale, m.size_u - 0.04F * scale),
                                coverage(p.v, p.size_v, 0.04F * scale, m.size_v - 0.04F * scale));
  float tone = 0.6F * noise(p, 0.5F * scale, m.seed) + 1.1F * flecks(p, 0.45F * scale, m.seed + 1) +
               0.9F * flecks(p, 0.19F * scale, m.seed + 2);
  const float row = periodicCoverage(p.v, p.size_v, 0.17F * scale, 0.02F * scale, 0.1F * scale);
  tone += row * (1.0F * flecks(p, 0.06F * scale, m.seed + 3) +
                 0.5F * flecks(p, 0.021F * scale, m.seed + 4));
  const float inside = m.albedo * (1.0F + m.contrast * tone);
  return blend(0.9F, std::max(0.03F, inside), border);
}

constexpr float kBoard = 0.03F;  // thickness of a shelf's board [m]

/// Light from three books of random breadth, height and tone in a stretch of a board.
float books(const Material& m, const Patch& p, int stretch, int level) {
  const std::uint32_t h = cellHash(m.seed, stretch, level);
  const float foot = static_cast<float>(level) * m.size_v;
  const std::array<float, 4> borders = {0.0F, 0.2F + 0.2F * unit(h, 0), 0.55F + 0.25F * unit(h, 1),
                                        1.0F};
  float sum = 0.0F;
  for (std::size_t book = 0; book < 3; ++book) {
    const std::uint32_t b = mix(h + static_cast<std::uint32_t>(book) + 1U);
    const float begin = (static_cast<float>(stretch) + borders[book]) * m.size_u;
    const float end = (static_cast<float>(stretch) + borders[book + 1]) * m.size_u;
    const float top = foot + m.size_v * (0.55F + 0.35F * unit(b, 1));
    const float label = coverage(p.v, p.size_v, foot + 0.2F * m.size_v, foot + 0.3F * m.size_v);
    const float cover = coverage(p.v, p.size_v, foot + kBoard, top) - label;
    sum += coverage(p.u, p.size_u, begin, end) *
           (cover * (0.1F + 0.8F * unit(b, 0)) + label * (0.1F + 0.8F * unit(b, 2)));
  }
  return sum;
}

float shelf(const Material& m, const Patch& p) {
  constexpr float kMean = 0.35F;
  const float seen = visibility(3.0F * m.size_u, p.size_u) * visibility(3.0F * m.size_v, p.size_v);
  float tone = 0.0F;
  if (seen > 0.0F) {
    const CellRange stretches(p.u / m.size_u, p.size_u / m.size_u);
    const CellRange levels(p.v / m.size_v, p.size_v / m.size_v);
    for (int level = levels.first; level <= levels.last; ++level) {
      for (int stretch = stretches.first; stretch <= stretches.last; ++stretch) {
        tone += books(m, p, stretch, level);
      }
    }
  }
  const float board = periodicCoverage(p.v, p.size_v, m.size_v, 0.0F, kBoard);
  return m.albedo * (blend(kMean, tone, seen) + 1.1F * board);
}

float leaves(const Material& m, const Patch& p) {
  const float tone = 0.5F * noise(p, 0.9F, m.seed) + 0.6F * noise(p, 0.27F, m.seed + 1) +
                     0.8F * noise(p, 0.11F, m.seed + 2) + 0.8F * flecks(p, 0.21F, m.seed + 3) +
                     0.9F * flecks(p, 0.08F, m.seed + 4) + 0.8F * noise(p, 0.04F, m.seed + 5);
  return m.albedo * std::max(0.12F, 1.0F + m.contrast * tone);
}

/// Soft round spots, one in every cell of a grid and a third to all of it wide, of a tone in
/// [-1, 1] in the middle.
float roundSpots(const Patch& p, float cells_per_m, std::uint32_t seed) {
  const float seen =
      visibility(1.0F, p.size_u * cells_per_m) * visibility(1.0F, p.size_v * cells_per_m);
  if (seen <= 0.0F) return 0.0F;
  const float u = p.u * cells_per_m;
  const float v = p.v * cells_per_m;
  const int iu = floorToInt(u);
  const int iv = floorToInt(v);
  const std::uint32_t h = cellHash(seed, iu, iv);
  const float radius = 0.16F + 0.34F * unit(h, 0);
  const float room = 1.0F - 2.0F * radius;
  const float du = u - static_cast<float>(iu) - radius - room * unit(h, 1);
  const float dv = v - static_cast<float>(iv) - radius - room * unit(h, 2);
  const float outside = du * du + dv * dv - radius * radius;
  if (outside >= 0.0F) return 0.0F;
  const float inside = outside / (radius * radius);
  return seen * inside * inside * (2.0F * unit(h, 3) - 1.0F);
}

float spots(const Material& m, const Patch& p) {
  // Spots of 6 to 20 cm and of 3 to 9 cm.
  const float tone =
      roundSpots(p, 5.0F, m.seed) + roundSpots(p, 10.8F, m.seed + 1) + noise(p, 2.7F, m.seed + 2);
  return m.albedo * (1.0F + m.contrast * tone);
}

float wall(const Material& m, const Patch& p) {
  switch (m.pattern) {
    case Pattern::kPlain:
      return plain(m, p);
    case Pattern::kRough:
      return rough(m, p);
    case Pattern::kBricks:
      return bricks(m, p);
    case Pattern::kTiles:
      return tiles(m, p);
    case Pattern::kPanels:
      return panels(m, p);
    case Pattern::kPicture:
      return picture(m, p);
    case Pattern::kShelf:
      return shelf(m, p);
    case Pattern::kLeaves:
      return leaves(m, p);
    case Pattern::kSpots:
      return spots(m, p);
  }
  return m.albedo;
}

/// Frame, bars, glass and curtains of the windows, seen at the depth of the glass.
float glass(const Material& m, const Patch& p) {
  const Windows& w = m.windows;
  constexpr float kFrame = 0.07F;
  const std::uint32_t h =
      cellHash(m.seed + 7, floorToInt(p.u / w.pitch_u), floorToInt(p.v / w.pitch_v));
  const float left = 0.5F * (w.pitch_u - w.width);
  const float middle = 0.5F * w.pitch_u;
  const float cross = w.sill + w.height * 0.68F;
  const auto column = [&](float begin, float end) {
    return periodicCoverage(p.u, p.size_u, w.pitch_u, begin, end);
  };
  const auto row = [&](float begin, float end) {
    return periodicCoverage(p.v, p.size_v, w.pitch_v, begin, end);
  };
  const float panes =
      (column(left + kFrame, middle - 0.5F * kFrame) +
       column(middle + 0.5F * kFrame, left + w.width - kFrame)) *
      (row(w.sill + kFrame, cross) + row(cross + kFrame, w.sill + w.height - kFrame));
  const float seen = visibility(w.pitch_u, p.size_u) * visibility(w.pitch_v, p.size_v);
  const float blind = row(w.sill + w.height * (0.3F + 0.7F * unit(h, 0)), w.sill + w.height);
  const float curtain = column(left, left + w.width * 0.45F * unit(h, 1));
  float behind = 0.08F + 0.1F * unit(h, 2);
  behind = blend(behind, 0.55F, 0.8F * seen * std::max(blind, curtain));
  return blend(0.75F, behind, std::min(1.0F, panes));
}

float wallWithWindows(const Material& m, const Patch& p) {
  const Windows& w = m.windows;
  const float left = 0.5F * (w.pitch_u - w.width);
  const auto opening = [&](float u, float v) {
    return periodicCoverage(u, p.size_u, w.pitch_u, left, left + w.width) *
           periodicCoverage(v, p.size_v, w.pitch_v, w.sill, w.sill + w.height);
  };
  const float open = opening(p.u, p.v);
  if (open <= 0.0F) return wall(m, p);
  Patch deep = p;
  deep.u += w.recess * p.slope_u;
  deep.v += w.recess * p.slope_v;
  const float seen = opening(deep.u, deep.v);  // the rest is the side of the opening
  const float behind =
      seen > 0.0F ? blend(0.65F * m.albedo, glass(m, deep), seen) : 0.65F * m.albedo;
  return open < 1.0F ? blend(wall(m, p), behind, open) : behind;
}

}  // namespace

Material makeMaterial(Pattern pattern, double albedo, double contrast, Random* random) {
  Material material;
  material.pattern = pattern;
  material.albedo = static_cast<float>(albedo);
  material.contrast = static_cast<float>(contrast);
  material.seed = random->bits();
  return material;
}

Material makeMaterial(Pattern pattern, double albedo, double contrast, const Eigen::Vector2d& size,
                      Random* random) {
  Material material = makeMaterial(pattern, albedo, contrast, random);
  material.size_u = static_cast<float>(size.x());
  material.size_v = static_cast<float>(size.y());
  return material;
}

float reflectance(const Material& material, const Patch& patch) {
  return material.windows.pitch_u > 0.0F ? wallWithWindows(material, patch) : wall(material, patch);
}

float skyRadiance(std::uint32_t seed, float clouds, float x, float y, float z) {
  const float level = std::sqrt(x * x + y * y) + 1e-6F;
  const float height = clampUnit(z / level);
  const float east = 2.0F * x / level;
  const float north = 2.0F * y / level;
  const Patch p{east + 0.7F * height, north - 0.4F * height, 0.0F, 0.0F, 0.0F, 0.0F};
  const float mist = 0.05F * noise(p, 0.35F, seed) + 0.03F * noise(p, 0.12F, seed + 1);
  const float misty = 0.86F - 0.12F * height + 2.0F * mist * height;
  if (clouds <= 0.0F) return misty;
  const float distance = 1.0F / (height + 0.2F);  // to a layer of clouds
  const Patch layer{distance * x / level, distance * y / level, 0.0F, 0.0F, 0.0F, 0.0F};
  const float density = noise(layer, 1.2F, seed + 2) + 0.5F * noise(layer, 0.45F, seed + 3) +
                        0.3F * noise(layer, 0.17F, seed + 4) + 0.2F * noise(layer, 0.07F, seed + 5);
  const float cloud = clampUnit(0.45F + 1.1F * density);
  return misty - 0.3F * clouds * (1.0F - cloud) * clampUnit(6.0F * height);
}

}  // namespace point_line_odometry::world
