// The irregular shadow map (Johnson, Lee, Burns, Mark: The irregular Z-buffer, ACM TOG 24(4), 2005): every surface
// point is a sample, and each triangle that may shade is tested against exactly the samples beneath it. No resolution,
// no bias: under a closed surface only what faces away from the Sun needs to cast, and a point never lies on such a
// facet.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "engine/frame.h"
#include "engine/raster_kernels.h"
#include "engine/refine.h"

namespace selenograph::engine {

// A surface point that faces the Sun, in light space.
struct LightSample {
  float u, v, d;
  std::uint32_t pixel;
};

// Sixteen surface points in light space.
struct LightLanes {
  alignas(64) float u[kPacket], v[kPacket], d[kPacket];
};

// Samples of one tile, and the box that they lie in.
struct LightSamples {
  std::vector<LightSample> list;  // the first `count`
  std::size_t count = 0;
  float low[2], high[2];  // u, v
  void clear(std::size_t capacity);
  void add(const LightSample& s) {
    list[count++] = s;
    low[0] = std::min(low[0], s.u), high[0] = std::max(high[0], s.u);
    low[1] = std::min(low[1], s.v), high[1] = std::max(high[1], s.v);
  }
};

// What a map needs while it works; kept from frame to frame.
struct LightScratch {
  std::vector<LightSamples> tiles;
  std::vector<std::vector<LightSample>> sorted;      // each tile's, by band
  std::vector<std::vector<std::uint32_t>> first;     // of each band, per tile
  std::vector<std::vector<std::uint32_t>> shadowed;  // pixels, per band
  std::size_t bytes() const;
};

class ShadowMap {
 public:
  // `sun`: unit, toward it.
  ShadowMap(const RasterMesh& mesh, const Vec3& sun);

  void place(const SurfacePoints& points, LightLanes& lanes) const;

  // From scratch.tiles to scratch.shadowed: the pixels of all samples in shadow, in any order. Parallel; stops between
  // bands.
  void cast(LightScratch& scratch, const StopToken& stop) const;

 private:
  struct Caster {
    float v_low, v_high, u_low, u_high, d_high;
  };

  const RasterMesh& mesh_;
  Vec3 u_, v_, d_;
  LightAxes axes_;
  std::vector<Caster> casters_;  // per strip
};

}  // namespace selenograph::engine
