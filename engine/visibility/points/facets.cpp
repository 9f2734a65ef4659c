#include "engine/visibility/points/facets.h"

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/points/facets.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_CORNER_OFFSETS
#define SELENOGRAPH_ENGINE_CORNER_OFFSETS
namespace selenograph::engine {

// Byte offsets of the corners of sixteen triangles in the tables of their blocks. Corner 0 lies in row 0 and column 0,
// corner 1 in row 0 and column 1, corner 2 in row 1 and column 0; the upper half of a quad counts rows and columns from
// the other end.
struct alignas(64) CornerOffsets {
  std::uint32_t row[2][kPacket], column[2][kPacket], vertex[3][kPacket];
};

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

#if HWY_TARGET == HWY_SCALAR

// Gathers the triangles one by one, on machines without vectors. Returns no lanes.
unsigned Gather(const Mesh& mesh, const TriangleId ids[kPacket], Facets& out) {
  for (int i = 0; i < kPacket; ++i) {
    const dem::Triangle t = mesh.triangle(ids[i]);
    const dem::QuadVertices q = ids[i].vertices();
    const MeshBlock& block = mesh.blocks()[ids[i].block()];
    for (int k = 0; k < 3; ++k) {
      out.a[k][i] = t.a[k];
      out.b[k][i] = t.b[k];
      out.c[k][i] = t.c[k];
      out.normal_a[k][i] = block.normal(q.r[0], q.c[0])[k];
      out.normal_b[k][i] = block.normal(q.r[1], q.c[1])[k];
      out.normal_c[k][i] = block.normal(q.r[2], q.c[2])[k];
    }
  }
  return 0;
}

#else

namespace hn = hwy::HWY_NAMESPACE;

// Loads the 16-byte entries at(0), at(1), ..., one for each 128-bit block of a vector.
template <class D, class At>
HWY_INLINE hn::Vec<D> load_entries(D d, const At& at) {
  if constexpr (hn::MaxLanes(D()) * sizeof(hn::TFromD<D>) == 16) {
    return hn::LoadU(d, at(0));
  } else {
    constexpr hn::Half<D> half;
    constexpr std::size_t kHalf = hn::MaxLanes(half) * sizeof(hn::TFromD<D>) / 16;
    return hn::Combine(d, load_entries(half, [&](std::size_t k) { return at(k + kHalf); }), load_entries(half, at));
  }
}

// Loads the sines and cosines of one lane after the other. at(i): the entry of lane i.
template <class D, class At>
HWY_INLINE void load_turns(D d, const At& at, hn::Vec<D>& sine, hn::Vec<D>& cosine) {
  const auto even = load_entries(d, [&](std::size_t k) { return at(2 * k); });
  const auto odd = load_entries(d, [&](std::size_t k) { return at(2 * k + 1); });
  sine = hn::InterleaveLower(d, even, odd);
  cosine = hn::InterleaveUpper(d, even, odd);
}

// Loads the heights and normals of one lane after the other: a transposition of 4 x 4 floats in each 128-bit block.
template <class F, class At>
HWY_INLINE void load_vertices(F f, const At& at, hn::Vec<F>& height, hn::Vec<F> (&normal)[3]) {
  constexpr hn::Repartition<double, F> pairs;
  hn::Vec<F> entry[4];
  for (std::size_t i = 0; i < 4; ++i) entry[i] = load_entries(f, [&](std::size_t k) { return at(4 * k + i); });
  const auto low01 = hn::BitCast(pairs, hn::InterleaveLower(f, entry[0], entry[1]));
  const auto low23 = hn::BitCast(pairs, hn::InterleaveLower(f, entry[2], entry[3]));
  const auto high01 = hn::BitCast(pairs, hn::InterleaveUpper(f, entry[0], entry[1]));
  const auto high23 = hn::BitCast(pairs, hn::InterleaveUpper(f, entry[2], entry[3]));
  height = hn::BitCast(f, hn::InterleaveLower(pairs, low01, low23));
  normal[0] = hn::BitCast(f, hn::InterleaveUpper(pairs, low01, low23));
  normal[1] = hn::BitCast(f, hn::InterleaveLower(pairs, high01, high23));
  normal[2] = hn::BitCast(f, hn::InterleaveUpper(pairs, high01, high23));
}

// The block of each lane: the same one for all, or one per lane.
struct OneBlock {
  const MeshBlock& block;
  const MeshBlock& operator()(std::size_t) const { return block; }
};
struct BlockPerLane {
  const MeshBlock* blocks[kPacket];
  const MeshBlock& operator()(std::size_t i) const { return *blocks[i]; }
};

// Sets vertices and their normals from the offsets. The tables of a block: `vertices` holds height and normal, `rows`
// and `columns` sine and cosine of latitude and longitude. `block`: OneBlock or BlockPerLane.
template <class Blocks>
HWY_INLINE void compute_vertices(const Blocks& block, const CornerOffsets& offsets, Facets& out) {
  constexpr hn::CappedTag<float, kPacket> f;
  constexpr hn::Repartition<double, decltype(f)> d;
  constexpr hn::Half<decltype(f)> half;
  constexpr std::size_t kFloats = hn::MaxLanes(f), kDoubles = hn::MaxLanes(d);
  using V = hn::Vec<decltype(d)>;
  const V moon = hn::Set(d, kMoonRadius_m);
  const auto entry = [](const auto& table, std::uint32_t offset) {
    return reinterpret_cast<const std::byte*>(table.data()) + offset;
  };
  for (std::size_t first = 0; first < kPacket; first += kFloats) {
    hn::Vec<decltype(f)> heights[3];
    float(*const normals[3])[kPacket] = {out.normal_a, out.normal_b, out.normal_c};
    for (std::size_t corner = 0; corner < 3; ++corner) {
      hn::Vec<decltype(f)> normal[3];
      const auto vertex = [&](std::size_t i) {
        return reinterpret_cast<const float*>(entry(block(first + i).vertices, offsets.vertex[corner][first + i]));
      };
      load_vertices(f, vertex, heights[corner], normal);
      for (std::size_t k = 0; k < 3; ++k) hn::Store(normal[k], f, normals[corner][k] + first);
    }
    for (std::size_t i = first; i < first + kFloats; i += kDoubles) {
      V sin_lat[2], cos_lat[2], sin_lon[2], cos_lon[2];
      for (std::size_t k = 0; k < 2; ++k) {
        const auto row = [&](std::size_t lane) {
          return reinterpret_cast<const double*>(entry(block(i + lane).rows, offsets.row[k][i + lane]));
        };
        const auto column = [&](std::size_t lane) {
          return reinterpret_cast<const double*>(entry(block(i + lane).columns, offsets.column[k][i + lane]));
        };
        load_turns(d, row, sin_lat[k], cos_lat[k]);
        load_turns(d, column, sin_lon[k], cos_lon[k]);
      }
      const auto compute_corner = [&](std::size_t corner, int row, int column, double(*to)[kPacket]) {
        // Compute in the order of dem::Block::position: the bits must be equal.
        const auto height = i == first ? hn::LowerHalf(half, heights[corner]) : hn::UpperHalf(half, heights[corner]);
        const V radius = hn::Add(moon, hn::PromoteTo(d, height));
        const V level = hn::Mul(radius, cos_lat[row]);
        hn::Store(hn::Mul(level, cos_lon[column]), d, to[0] + i);
        hn::Store(hn::Mul(level, sin_lon[column]), d, to[1] + i);
        hn::Store(hn::Mul(radius, sin_lat[row]), d, to[2] + i);
      };
      compute_corner(0, 0, 0, out.a);
      compute_corner(1, 0, 1, out.b);
      compute_corner(2, 1, 0, out.c);
    }
  }
}

// Computes the offsets of a lane's triangle in a block of this side.
HWY_INLINE void find_offsets(const TriangleId& triangle, std::uint32_t side, int i, CornerOffsets& out) {
  const std::uint32_t id = triangle.packed();
  const std::uint32_t upper = id & 1, r = id >> 7 & 63, c = id >> 1 & 63;
  const std::uint32_t r0 = r + upper;
  const std::uint32_t r1 = r + 1 - upper;
  const std::uint32_t c0 = c + upper;
  const std::uint32_t c1 = c + 1 - upper;
  constexpr std::uint32_t kTurn = sizeof(MeshBlock::Turn);
  constexpr std::uint32_t kVertex = sizeof(dem::Vertex);
  out.row[0][i] = kTurn * r0;
  out.row[1][i] = kTurn * r1;
  out.column[0][i] = kTurn * c0;
  out.column[1][i] = kTurn * c1;
  out.vertex[0][i] = kVertex * (r0 * side + c0);
  out.vertex[1][i] = kVertex * (r0 * side + c1);
  out.vertex[2][i] = kVertex * (r1 * side + c0);
}

// Gathers the triangles. Returns the lanes, one bit each, whose vertices may differ from what their row and column say:
// those on the border of a block with collapsed quads.
unsigned Gather(const Mesh& mesh, const TriangleId ids[kPacket], Facets& out) {
  CornerOffsets offsets;
  unsigned collapsed = 0;
  const auto mark_if_on_border = [&](const MeshBlock& block, int i) {
    if (block.on_border(ids[i].r(), ids[i].c())) collapsed |= 1U << i;
  };
  const MeshBlock& first = mesh.blocks()[ids[0].block()];
  const auto side = static_cast<std::uint32_t>(first.side);
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) find_offsets(ids[i], side, i, offsets);
  // Have the offsets loaded from memory: compilers would extract them from vectors, which takes longer.
  asm volatile("" ::: "memory");
  // Handle packets in one block separately: this is the common case.
  if (in_one_block(ids)) {
    for (int i = 0; i < kPacket && first.collapses; ++i) mark_if_on_border(first, i);
    compute_vertices(OneBlock{first}, offsets, out);
    return collapsed;
  }
  BlockPerLane blocks;
  for (int i = 0; i < kPacket; ++i) {
    const MeshBlock& block = mesh.blocks()[ids[i].block()];
    blocks.blocks[i] = &block;
    if (block.side != first.side) find_offsets(ids[i], static_cast<std::uint32_t>(block.side), i, offsets);
    if (block.collapses) mark_if_on_border(block, i);
  }
  compute_vertices(blocks, offsets, out);
  return collapsed;
}

#endif  // HWY_TARGET == HWY_SCALAR

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(Gather);

// Gathers the triangles, and then places those with collapsed vertices one by one.
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

void gather_brightness(const Mesh& mesh, const TriangleId ids[kPacket], VertexBrightness& out) {
  for (int i = 0; i < kPacket; ++i) {
    const MeshBlock& block = mesh.blocks()[ids[i].block()];
    if (block.brightness.empty()) {
      out.a[i] = out.b[i] = out.c[i] = dem::kBrightnessOfOne;
      continue;
    }
    // In the upper half of a quad, the second vertex is west of the first one and the third south of it.
    const int upper = ids[i].upper() ? 1 : 0, step = 1 - 2 * upper;
    const std::uint16_t* first = &block.brightness[block.posts->index(ids[i].r() + upper, ids[i].c() + upper)];
    out.a[i] = *first;
    out.b[i] = first[step];
    out.c[i] = first[step * block.side];
  }
}

void interpolate_brightness(const VertexBrightness& vertices, const float* v, const float* w, float* out) {
  for (int i = 0; i < kPacket; ++i) {
    const auto a = static_cast<float>(vertices.a[i]), b = static_cast<float>(vertices.b[i]),
               c = static_cast<float>(vertices.c[i]);
    out[i] = (a + v[i] * (b - a) + w[i] * (c - a)) / float{dem::kBrightnessOfOne};
  }
}

void interpolate_brightness(const Mesh& mesh, const SurfacePoints& points, float* out) {
  VertexBrightness vertices;
  gather_brightness(mesh, points.triangle, vertices);
  float v[kPacket], w[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    v[i] = static_cast<float>(points.v[i]);
    w[i] = static_cast<float>(points.w[i]);
  }
  interpolate_brightness(vertices, v, w, out);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
