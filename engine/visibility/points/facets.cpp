#include "engine/visibility/points/facets.h"

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/points/facets.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_RAW_FACETS
#define SELENOGRAPH_ENGINE_RAW_FACETS
namespace selenograph::engine {

// Triangles as they lie in the mesh. Rows and columns are those of the quad, in ascending order. The corners of a
// triangle are (row 0, column 0), (row 0, column 1) and (row 1, column 0) of its half of the quad; the upper half
// counts rows and columns from the other end.
struct alignas(64) RawFacets {
  dem::Vertex vertex[3][kPacket];
  MeshBlock::Turn rows[kPacket][2], columns[kPacket][2];
  double upper[kPacket];  // 1 or 0
};

// Byte offsets of the quad and the corners of a triangle in the tables of its block.
struct alignas(64) TableOffsets {
  std::uint32_t row[kPacket], column[kPacket], vertex[3][kPacket];
};

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

HWY_INLINE void compute_vertices(const RawFacets& raw, Facets& out) {
  constexpr hn::CappedTag<double, 8> d;
  constexpr hn::Rebind<float, decltype(d)> f;
  using V = hn::Vec<decltype(d)>;
  const auto lanes = static_cast<int>(hn::Lanes(d));
  const V moon = hn::Set(d, kMoonRadius_m);
  for (int i = 0; i < kPacket; i += lanes) {
    V sin_lat[2], cos_lat[2], sin_lon[2], cos_lon[2];
    hn::LoadInterleaved4(d, &raw.rows[i][0].sin, sin_lat[0], cos_lat[0], sin_lat[1], cos_lat[1]);
    hn::LoadInterleaved4(d, &raw.columns[i][0].sin, sin_lon[0], cos_lon[0], sin_lon[1], cos_lon[1]);
    const auto upper = hn::Ne(hn::Load(d, raw.upper + i), hn::Zero(d));
    for (V* ends : {sin_lat, cos_lat, sin_lon, cos_lon}) {
      const V first = ends[0];
      ends[0] = hn::IfThenElse(upper, ends[1], first);
      ends[1] = hn::IfThenElse(upper, first, ends[1]);
    }
    const auto compute_corner = [&](int corner, int row, int column, double(*at)[kPacket], float(*normal)[kPacket]) {
      hn::Vec<decltype(f)> height, x, y, z;
      hn::LoadInterleaved4(f, &raw.vertex[corner][i].height_m, height, x, y, z);
      hn::Store(x, f, normal[0] + i);
      hn::Store(y, f, normal[1] + i);
      hn::Store(z, f, normal[2] + i);
      // Compute in the order of dem::Block::position: the bits must be equal.
      const V radius = hn::Add(moon, hn::PromoteTo(d, height));
      const V level = hn::Mul(radius, cos_lat[row]);
      hn::Store(hn::Mul(level, cos_lon[column]), d, at[0] + i);
      hn::Store(hn::Mul(level, sin_lon[column]), d, at[1] + i);
      hn::Store(hn::Mul(radius, sin_lat[row]), d, at[2] + i);
    };
    compute_corner(0, 0, 0, out.a, out.normal_a);
    compute_corner(1, 0, 1, out.b, out.normal_b);
    compute_corner(2, 1, 0, out.c, out.normal_c);
  }
}

// Computes the offsets of triangles in blocks of the same side.
HWY_INLINE void find_offsets(const TriangleId* ids, std::uint32_t side, TableOffsets& out, double* upper_half) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const std::uint32_t id = ids[i].packed();
    const std::uint32_t upper = id & 1, r = id >> 7 & 63, c = id >> 1 & 63;
    const std::uint32_t r0 = r + upper;
    const std::uint32_t r1 = r + 1 - upper;
    const std::uint32_t c0 = c + upper;
    const std::uint32_t c1 = c + 1 - upper;
    constexpr std::uint32_t kTurn = sizeof(MeshBlock::Turn);
    constexpr std::uint32_t kVertex = sizeof(dem::Vertex);
    upper_half[i] = static_cast<double>(upper);
    out.row[i] = kTurn * r;
    out.column[i] = kTurn * c;
    out.vertex[0][i] = kVertex * (r0 * side + c0);
    out.vertex[1][i] = kVertex * (r0 * side + c1);
    out.vertex[2][i] = kVertex * (r1 * side + c0);
  }
}

// Copies the lanes from first to past_last, all in one block.
HWY_INLINE void copy_lanes(const MeshBlock& block, const TableOffsets& at, int first, int past_last, RawFacets& raw) {
  const auto* vertices = reinterpret_cast<const std::byte*>(block.vertices.data());
  const auto* rows = reinterpret_cast<const std::byte*>(block.rows.data());
  const auto* columns = reinterpret_cast<const std::byte*>(block.columns.data());
  for (int i = first; i < past_last; ++i) {
    for (int k = 0; k < 3; ++k)
      std::memcpy(static_cast<void*>(&raw.vertex[k][i]), vertices + at.vertex[k][i], sizeof(dem::Vertex));
    std::memcpy(raw.rows[i], rows + at.row[i], sizeof raw.rows[i]);
    std::memcpy(raw.columns[i], columns + at.column[i], sizeof raw.columns[i]);
  }
}

// Gathers the triangles. Returns the lanes, one bit each, whose vertices may differ from what their row and column say:
// those on the border of a block with collapsed quads.
unsigned Gather(const Mesh& mesh, const TriangleId ids[kPacket], Facets& out) {
  RawFacets raw;
  TableOffsets at;
  unsigned collapsed = 0;
  const auto mark_if_on_border = [&](const MeshBlock& block, int i) {
    if (block.on_border(ids[i].r(), ids[i].c())) collapsed |= 1U << i;
  };
  const MeshBlock& first = mesh.blocks()[ids[0].block()];
  find_offsets(ids, static_cast<std::uint32_t>(first.side), at, raw.upper);
  // Handle packets in one block separately: this is the common case, and then all lanes are fetched independently.
  if (in_one_block(ids)) {
    copy_lanes(first, at, 0, kPacket, raw);
    for (int i = 0; i < kPacket && first.collapses; ++i) mark_if_on_border(first, i);
  } else {
    int side = first.side;
    for (int i = 0; i < kPacket; ++i) {
      const MeshBlock& block = mesh.blocks()[ids[i].block()];
      if (block.side != side) find_offsets(ids, static_cast<std::uint32_t>(side = block.side), at, raw.upper);
      copy_lanes(block, at, i, i + 1, raw);
      if (block.collapses) mark_if_on_border(block, i);
    }
  }
  compute_vertices(raw, out);
  return collapsed;
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(Gather);

void gather(const Mesh& mesh, const TriangleId ids[kPacket], Facets& out) {
  unsigned collapsed = HWY_DYNAMIC_DISPATCH(Gather)(mesh, ids, out);
  for (int i = 0; collapsed != 0; ++i, collapsed >>= 1) {
    if (!(collapsed & 1)) continue;
    const dem::Triangle t = mesh.triangle(ids[i]);
    for (int k = 0; k < 3; ++k) {
      out.a[k][i] = t.a[k];
      out.b[k][i] = t.b[k];
      out.c[k][i] = t.c[k];
    }
  }
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
