#include "engine/facets.h"

#include <cstring>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/facets.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_RAW_FACETS
#define SELENOGRAPH_ENGINE_RAW_FACETS
namespace selenograph::engine {

// As they lie in the mesh, one triangle after the other. Its corners are (row 0, column 0), (row 0, column 1) and
// (row 1, column 0), whichever half of a quad it is.
struct alignas(64) RawFacets {
  MeshVertex vertex[3][kPacket];
  MeshBlock::Turn rows[kPacket][2], columns[kPacket][2];
};

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

void PlaceVertices(const RawFacets& raw, Facets& out) {
  constexpr hn::CappedTag<double, 8> d;
  constexpr hn::Rebind<float, decltype(d)> f;
  using V = hn::Vec<decltype(d)>;
  const auto lanes = static_cast<int>(hn::Lanes(d));
  const V moon = hn::Set(d, kMoonRadius_m);
  for (int i = 0; i < kPacket; i += lanes) {
    V sin_lat[2], cos_lat[2], sin_lon[2], cos_lon[2];
    hn::LoadInterleaved4(d, &raw.rows[i][0].sin, sin_lat[0], cos_lat[0], sin_lat[1], cos_lat[1]);
    hn::LoadInterleaved4(d, &raw.columns[i][0].sin, sin_lon[0], cos_lon[0], sin_lon[1], cos_lon[1]);
    const auto place = [&](int corner, int row, int column, double(*at)[kPacket], float(*normal)[kPacket]) {
      hn::Vec<decltype(f)> height, x, y, z;
      hn::LoadInterleaved4(f, &raw.vertex[corner][i].height_m, height, x, y, z);
      hn::Store(x, f, normal[0] + i), hn::Store(y, f, normal[1] + i), hn::Store(z, f, normal[2] + i);
      // In the order of dem::Block::position.
      const V radius = hn::Add(moon, hn::PromoteTo(d, height)), level = hn::Mul(radius, cos_lat[row]);
      hn::Store(hn::Mul(level, cos_lon[column]), d, at[0] + i);
      hn::Store(hn::Mul(level, sin_lon[column]), d, at[1] + i);
      hn::Store(hn::Mul(radius, sin_lat[row]), d, at[2] + i);
    };
    place(0, 0, 0, out.a, out.normal_a), place(1, 0, 1, out.b, out.normal_b), place(2, 1, 0, out.c, out.normal_c);
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(PlaceVertices);

void gather(const Mesh& mesh, const TriangleId ids[kPacket], Facets& out) {
  RawFacets raw;
  unsigned collapsed = 0;  // lanes whose vertices may lie elsewhere than their row and column say
  for (int i = 0; i < kPacket; ++i) {
    const TriangleId id = ids[i];
    const MeshBlock& block = mesh.blocks()[id.block()];
    const int upper = id.upper() ? 1 : 0, r0 = id.r() + upper, r1 = id.r() + 1 - upper, c0 = id.c() + upper,
              c1 = id.c() + 1 - upper;
    const auto copy = [&](int corner, int r, int c) {
      std::memcpy(static_cast<void*>(&raw.vertex[corner][i]), block.vertices.data() + r * block.side + c,
                  sizeof(MeshVertex));
    };
    copy(0, r0, c0), copy(1, r0, c1), copy(2, r1, c0);
    raw.rows[i][0] = block.rows[static_cast<std::size_t>(r0)],
    raw.rows[i][1] = block.rows[static_cast<std::size_t>(r1)];
    raw.columns[i][0] = block.columns[static_cast<std::size_t>(c0)],
    raw.columns[i][1] = block.columns[static_cast<std::size_t>(c1)];
    if (block.collapses && block.on_border(id.r(), id.c())) collapsed |= 1U << i;
  }
  HWY_DYNAMIC_DISPATCH(PlaceVertices)(raw, out);
  for (int i = 0; collapsed != 0; ++i, collapsed >>= 1) {
    if (!(collapsed & 1)) continue;
    const dem::Triangle t = mesh.triangle(ids[i]);
    for (int k = 0; k < 3; ++k) out.a[k][i] = t.a[k], out.b[k][i] = t.b[k], out.c[k][i] = t.c[k];
  }
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
