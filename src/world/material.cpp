#include "world/material.h"

#include <algorithm>
#include <array>

#include "common/processor_clones.h"
#include "world/noise.h"
#include "world/random.h"
#include "world/texture.h"

namespace point_line_odometry::world {
namespace {

POINT_LINE_ODOMETRY_CLONES("avx2")
void paintTones(const Material& m, const Values& tones, std::size_t n, Values* out) {
  for (std::size_t i = 0; i < n; ++i) (*out)[i] = m.albedo * (1.0F + m.contrast * tones[i]);
}

void rough(const Material& m, const PatchBatch& p, Values* out) {
  Values tones{};
  addRoughness(p, m.seed, 1.0F, &tones);
  paintTones(m, tones, p.size, out);
}

void plain(const Material& m, const PatchBatch& p, Values* out) {
  Values tones{};
  addNoise(p, 2.7F, m.seed, 1.0F, &tones);
  paintTones(m, tones, p.size, out);
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void bricks(const Material& m, const PatchBatch& p, Values* out) {
  constexpr float kJoint = 0.012F;
  Values offset{};
  for (std::size_t i = 0; i < p.size; ++i) {
    const int course = floorToInt(p.v[i] / m.size_v);
    offset[i] = (course & 1) != 0 ? 0.5F * m.size_u : 0.0F;
  }
  Values tones{};
  addCellTones(p, m, offset, 0.8F, &tones);
  addRoughness(p, m.seed + 100, 0.5F, &tones);
  const float joint = std::min(0.9F, 1.35F * m.albedo);
  for (std::size_t i = 0; i < p.size; ++i) {
    const float brick =
        periodicCoverage(p.u[i] + offset[i], p.size_u[i], m.size_u, kJoint, m.size_u) *
        periodicCoverage(p.v[i], p.size_v[i], m.size_v, kJoint, m.size_v);
    (*out)[i] = blend(joint, m.albedo * (1.0F + m.contrast * tones[i]), brick);
  }
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void tiles(const Material& m, const PatchBatch& p, Values* out) {
  const float joint_u = std::min(0.012F, 0.1F * m.size_u);
  const float joint_v = std::min(0.012F, 0.1F * m.size_v);
  Values tones{};
  addCellTones(p, m, Values{}, 0.7F, &tones);
  addRoughness(p, m.seed + 100, 0.5F, &tones);
  for (std::size_t i = 0; i < p.size; ++i) {
    const float tile = periodicCoverage(p.u[i], p.size_u[i], m.size_u, joint_u, m.size_u) *
                       periodicCoverage(p.v[i], p.size_v[i], m.size_v, joint_v, m.size_v);
    (*out)[i] = blend(0.55F * m.albedo, m.albedo * (1.0F + m.contrast * tones[i]), tile);
  }
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void panels(const Material& m, const PatchBatch& p, Values* out) {
  constexpr float kGroove = 0.014F;
  plain(m, p, out);
  for (std::size_t i = 0; i < p.size; ++i) {
    const float panel = periodicCoverage(p.u[i], p.size_u[i], m.size_u, kGroove, m.size_u) *
                        periodicCoverage(p.v[i], p.size_v[i], m.size_v, kGroove, m.size_v);
    (*out)[i] *= blend(0.45F, 1.0F, panel);
  }
}

/// Shapes over a background, and rows of letters.
POINT_LINE_ODOMETRY_CLONES("avx2")
void picture(const Material& m, const PatchBatch& p, Values* out) {
  const float scale = std::min(m.size_u, m.size_v);
  Values shapes{};
  addNoise(p, 0.5F * scale, m.seed, 0.6F, &shapes);
  addFlecks(p, 0.45F * scale, m.seed + 1, 1.1F, &shapes);
  addFlecks(p, 0.19F * scale, m.seed + 2, 0.9F, &shapes);
  Values letters{};
  addFlecks(p, 0.06F * scale, m.seed + 3, 1.0F, &letters);
  addFlecks(p, 0.021F * scale, m.seed + 4, 0.5F, &letters);
  for (std::size_t i = 0; i < p.size; ++i) {
    const float border =
        std::min(coverage(p.u[i], p.size_u[i], 0.04F * scale, m.size_u - 0.04F * scale),
                 coverage(p.v[i], p.size_v[i], 0.04F * scale, m.size_v - 0.04F * scale));
    const float row =
        periodicCoverage(p.v[i], p.size_v[i], 0.17F * scale, 0.02F * scale, 0.1F * scale);
    const float inside = m.albedo * (1.0F + m.contrast * (shapes[i] + row * letters[i]));
    (*out)[i] = blend(0.9F, std::max(0.03F, inside), border);
  }
}

constexpr float kBoard = 0.03F;  // thickness of a shelf's board [m]

/// Light from three books of random breadth, height and tone in a stretch of a board.
inline float books(const Material& m, const PatchBatch& p, std::size_t i, int stretch, int level) {
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
    const float label =
        coverage(p.v[i], p.size_v[i], foot + 0.2F * m.size_v, foot + 0.3F * m.size_v);
    const float cover = coverage(p.v[i], p.size_v[i], foot + kBoard, top) - label;
    sum += coverage(p.u[i], p.size_u[i], begin, end) *
           (cover * (0.1F + 0.8F * unit(b, 0)) + label * (0.1F + 0.8F * unit(b, 2)));
  }
  return sum;
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void shelf(const Material& m, const PatchBatch& p, Values* out) {
  constexpr float kMean = 0.35F;
  const InCells c = inCellsOf(m, p, Values{}, 3.0F);
  Values light{};
  addCells(
      c, p.size, [&](std::size_t i, int column, int row) { return books(m, p, i, column, row); },
      &light);
  for (std::size_t i = 0; i < p.size; ++i) {
    const float board = periodicCoverage(p.v[i], p.size_v[i], m.size_v, 0.0F, kBoard);
    const float lit = c.seen[i] > 0.0F ? light[i] : 0.0F;
    (*out)[i] = m.albedo * (blend(kMean, lit, c.seen[i]) + 1.1F * board);
  }
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void leaves(const Material& m, const PatchBatch& p, Values* out) {
  Values tones{};
  addNoise(p, 0.9F, m.seed, 0.5F, &tones);
  addNoise(p, 0.27F, m.seed + 1, 0.6F, &tones);
  addNoise(p, 0.11F, m.seed + 2, 0.8F, &tones);
  addFlecks(p, 0.21F, m.seed + 3, 0.8F, &tones);
  addFlecks(p, 0.08F, m.seed + 4, 0.9F, &tones);
  addNoise(p, 0.04F, m.seed + 5, 0.8F, &tones);
  for (std::size_t i = 0; i < p.size; ++i) {
    (*out)[i] = m.albedo * std::max(0.12F, 1.0F + m.contrast * tones[i]);
  }
}

void spots(const Material& m, const PatchBatch& p, Values* out) {
  Values tones{};
  addRoundSpots(p, 5.0F, m.seed, &tones);       // of 6 to 20 cm
  addRoundSpots(p, 10.8F, m.seed + 1, &tones);  // of 3 to 9 cm
  addNoise(p, 2.7F, m.seed + 2, 1.0F, &tones);
  paintTones(m, tones, p.size, out);
}

void wall(const Material& m, const PatchBatch& p, Values* out) {
  switch (m.pattern) {
    case Pattern::kPlain:
      return plain(m, p, out);
    case Pattern::kRough:
      return rough(m, p, out);
    case Pattern::kBricks:
      return bricks(m, p, out);
    case Pattern::kTiles:
      return tiles(m, p, out);
    case Pattern::kPanels:
      return panels(m, p, out);
    case Pattern::kPicture:
      return picture(m, p, out);
    case Pattern::kShelf:
      return shelf(m, p, out);
    case Pattern::kLeaves:
      return leaves(m, p, out);
    case Pattern::kSpots:
      return spots(m, p, out);
  }
}

/// Frame, bars, glass and curtains of the windows, at (u, v) at the depth of the glass.
inline float glass(const Material& m, float u, float v, float size_u, float size_v) {
  const Windows& w = m.windows;
  constexpr float kFrame = 0.07F;
  const std::uint32_t h =
      cellHash(m.seed + 7, floorToInt(u / w.pitch_u), floorToInt(v / w.pitch_v));
  const float left = 0.5F * (w.pitch_u - w.width);
  const float middle = 0.5F * w.pitch_u;
  const float cross = w.sill + w.height * 0.68F;
  const auto column = [&](float begin, float end) {
    return periodicCoverage(u, size_u, w.pitch_u, begin, end);
  };
  const auto row = [&](float begin, float end) {
    return periodicCoverage(v, size_v, w.pitch_v, begin, end);
  };
  const float panes =
      (column(left + kFrame, middle - 0.5F * kFrame) +
       column(middle + 0.5F * kFrame, left + w.width - kFrame)) *
      (row(w.sill + kFrame, cross) + row(cross + kFrame, w.sill + w.height - kFrame));
  const float seen = visibility(w.pitch_u, size_u) * visibility(w.pitch_v, size_v);
  const float blind = row(w.sill + w.height * (0.3F + 0.7F * unit(h, 0)), w.sill + w.height);
  const float curtain = column(left, left + w.width * 0.45F * unit(h, 1));
  const float room =
      blend(0.08F + 0.1F * unit(h, 2), 0.55F, 0.8F * seen * std::max(blind, curtain));
  return blend(0.75F, room, std::min(1.0F, panes));
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void wallWithWindows(const Material& m, const PatchBatch& p, Values* out) {
  const Windows& w = m.windows;
  const float left = 0.5F * (w.pitch_u - w.width);
  const auto opening = [&](float u, float v, std::size_t i) {
    return periodicCoverage(u, p.size_u[i], w.pitch_u, left, left + w.width) *
           periodicCoverage(v, p.size_v[i], w.pitch_v, w.sill, w.sill + w.height);
  };
  Values open;
  int any_open = 0;
  int any_closed = 0;
  for (std::size_t i = 0; i < p.size; ++i) {
    open[i] = opening(p.u[i], p.v[i], i);
    any_open |= static_cast<int>(open[i] > 0.0F);
    any_closed |= static_cast<int>(open[i] < 1.0F);
  }
  if (any_closed != 0) wall(m, p, out);
  if (any_open == 0) return;
  for (std::size_t i = 0; i < p.size; ++i) {
    const float u = p.u[i] + w.recess * p.slope_u[i];
    const float v = p.v[i] + w.recess * p.slope_v[i];
    const float seen = opening(u, v, i);  // the rest is the side of the opening
    const float behind = blend(0.65F * m.albedo, glass(m, u, v, p.size_u[i], p.size_v[i]), seen);
    const float before = open[i] < 1.0F ? (*out)[i] : 0.0F;
    const float mixed = open[i] < 1.0F ? blend(before, behind, open[i]) : behind;
    (*out)[i] = open[i] > 0.0F ? mixed : before;
  }
}

PatchBatch inFirstRepetition(PatchBatch patches, float length) {
  for (std::size_t i = 0; i < patches.size; ++i) {
    patches.u[i] -= length * static_cast<float>(floorToInt(patches.u[i] / length));
    patches.v[i] -= length * static_cast<float>(floorToInt(patches.v[i] / length));
  }
  return patches;
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

void reflectance(const Material& material, const PatchBatch& patches, Values* out) {
  if (material.repetition > 0.0F) {
    Material pattern = material;
    pattern.repetition = 0.0F;
    reflectance(pattern, inFirstRepetition(patches, material.repetition), out);
  } else if (material.windows.pitch_u > 0.0F) {
    wallWithWindows(material, patches, out);
  } else {
    wall(material, patches, out);
  }
}

}  // namespace point_line_odometry::world
