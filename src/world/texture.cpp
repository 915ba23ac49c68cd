#include "world/texture.h"

#include "common/processor_clones.h"

namespace point_line_odometry::world {
namespace {

/// Expects the places and sizes in cells, and their visibility.
POINT_LINE_ODOMETRY_CLONES("avx2")
void findCells(std::size_t n, InCells* c) {
  int any = 0;
  for (std::size_t i = 0; i < n; ++i) any |= static_cast<int>(c->seen[i] > 0.0F);
  if (any == 0) return;
  int columns = 0;
  int rows = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const bool visible = c->seen[i] > 0.0F;
    c->u[i] = visible ? c->u[i] : 0.0F;
    c->v[i] = visible ? c->v[i] : 0.0F;
    c->size_u[i] = visible ? c->size_u[i] : 1.0F;
    c->size_v[i] = visible ? c->size_v[i] : 1.0F;
    c->column[i] = floorToInt(c->u[i] - 0.5F * c->size_u[i]);
    c->row[i] = floorToInt(c->v[i] - 0.5F * c->size_v[i]);
    columns = std::max(columns, floorToInt(c->u[i] + 0.5F * c->size_u[i]) - c->column[i]);
    rows = std::max(rows, floorToInt(c->v[i] + 0.5F * c->size_v[i]) - c->row[i]);
  }
  c->columns = columns + 1;
  c->rows = rows + 1;
}

/// Area of the patch i that the rectangle of a cell covers, times its tone.
inline float fleck(const InCells& p, std::size_t i, int column, int row, std::uint32_t seed) {
  const std::uint32_t h = cellHash(seed, column, row);
  const float left = static_cast<float>(column) + 0.05F + 0.45F * unit(h, 0);
  const float width = overlap(p.u[i], p.size_u[i], left, left + 0.12F + 0.36F * unit(h, 2));
  const float low = static_cast<float>(row) + 0.05F + 0.45F * unit(h, 1);
  const float height = overlap(p.v[i], p.size_v[i], low, low + 0.12F + 0.36F * unit(h, 3));
  return std::max(0.0F, width) * std::max(0.0F, height) * tone(mix(h), 0);
}

}  // namespace

POINT_LINE_ODOMETRY_CLONES("avx2")
InCells inCellsOf(const Material& m, const PatchBatch& p, const Values& offset, float structure) {
  InCells c;
  for (std::size_t i = 0; i < p.size; ++i) {
    c.u[i] = (p.u[i] + offset[i]) / m.size_u;
    c.v[i] = p.v[i] / m.size_v;
    c.size_u[i] = p.size_u[i] / m.size_u;
    c.size_v[i] = p.size_v[i] / m.size_v;
    c.seen[i] = visibility(structure * m.size_u, p.size_u[i]) *
                visibility(structure * m.size_v, p.size_v[i]);
  }
  findCells(p.size, &c);
  return c;
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void addNoise(const PatchBatch& p, float size, std::uint32_t seed, float weight, Values* sum) {
  Values seen;
  int any = 0;
  for (std::size_t i = 0; i < p.size; ++i) {
    seen[i] = visibility(size, p.size_u[i]) * visibility(size, p.size_v[i]);
    any |= static_cast<int>(seen[i] > 0.0F);
  }
  if (any == 0) return;
  for (std::size_t i = 0; i < p.size; ++i) {
    const float x = p.u[i] / size;
    const float y = p.v[i] / size;
    const bool visible = seen[i] > 0.0F;
    const float noise = smoothNoise(visible ? x : 0.0F, visible ? y : 0.0F, seed);
    (*sum)[i] += weight * (seen[i] * noise);
  }
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void addFlecks(const PatchBatch& p, float size, std::uint32_t seed, float weight, Values* sum) {
  const float scale = 1.0F / size;
  InCells c;
  for (std::size_t i = 0; i < p.size; ++i) {
    c.u[i] = p.u[i] * scale;
    c.v[i] = p.v[i] * scale;
    c.size_u[i] = p.size_u[i] * scale;
    c.size_v[i] = p.size_v[i] * scale;
    c.seen[i] = visibility(1.0F, c.size_u[i]) * visibility(1.0F, c.size_v[i]);
  }
  findCells(p.size, &c);
  if (!c.visible()) return;
  Values covered{};
  addCells(
      c, p.size, [&](std::size_t i, int column, int row) { return fleck(c, i, column, row, seed); },
      &covered);
  for (std::size_t i = 0; i < p.size; ++i) {
    (*sum)[i] += weight * (c.seen[i] * covered[i] / (c.size_u[i] * c.size_v[i]));
  }
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void addRoughness(const PatchBatch& p, std::uint32_t seed, float weight, Values* sum) {
  Values noise{};
  addNoise(p, 1.7F, seed, 0.30F, &noise);
  addNoise(p, 0.31F, seed + 1, 0.30F, &noise);
  addNoise(p, 0.06F, seed + 2, 0.30F, &noise);
  addNoise(p, 0.015F, seed + 3, 0.30F, &noise);
  Values flecks{};
  addFlecks(p, 2.3F, seed + 4, 0.7F, &flecks);
  addFlecks(p, 0.5F, seed + 5, 0.8F, &flecks);
  addFlecks(p, 0.11F, seed + 6, 0.8F, &flecks);
  addFlecks(p, 0.03F, seed + 7, 0.8F, &flecks);
  for (std::size_t i = 0; i < p.size; ++i) (*sum)[i] += weight * (noise[i] + flecks[i]);
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void addCellTones(const PatchBatch& p, const Material& m, const Values& offset, float weight,
                  Values* sum) {
  const InCells c = inCellsOf(m, p, offset, 1.0F);
  if (!c.visible()) return;
  Values covered{};
  addCells(
      c, p.size,
      [&](std::size_t i, int column, int row) {
        const auto low = static_cast<float>(row);
        const auto left = static_cast<float>(column);
        return coverage(c.v[i], c.size_v[i], low, low + 1.0F) *
               coverage(c.u[i], c.size_u[i], left, left + 1.0F) *
               tone(cellHash(m.seed, column, row), 0);
      },
      &covered);
  for (std::size_t i = 0; i < p.size; ++i) (*sum)[i] += weight * (c.seen[i] * covered[i]);
}

POINT_LINE_ODOMETRY_CLONES("avx2")
void addRoundSpots(const PatchBatch& p, float cells_per_m, std::uint32_t seed, Values* sum) {
  for (std::size_t i = 0; i < p.size; ++i) {
    const float seen =
        visibility(1.0F, p.size_u[i] * cells_per_m) * visibility(1.0F, p.size_v[i] * cells_per_m);
    const float u = seen > 0.0F ? p.u[i] * cells_per_m : 0.0F;
    const float v = seen > 0.0F ? p.v[i] * cells_per_m : 0.0F;
    const int column = floorToInt(u);
    const int row = floorToInt(v);
    const std::uint32_t h = cellHash(seed, column, row);
    const float radius = 0.16F + 0.34F * unit(h, 0);
    const float room = 1.0F - 2.0F * radius;
    const float du = u - static_cast<float>(column) - radius - room * unit(h, 1);
    const float dv = v - static_cast<float>(row) - radius - room * unit(h, 2);
    const float outside = du * du + dv * dv - radius * radius;
    const float inside = std::min(0.0F, outside) / (radius * radius);
    (*sum)[i] += seen * inside * inside * tone(h, 3);
  }
}

}  // namespace point_line_odometry::world
