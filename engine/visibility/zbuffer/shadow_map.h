// The irregular shadow map (Johnson, Lee, Burns, Mark: The irregular Z-buffer, ACM TOG 24(4), 2005): every surface
// point is a sample, and each triangle that may shade is tested against exactly the samples beneath it. No resolution,
// no bias: under a closed surface only what faces away from the Sun needs to cast, and a point never lies on such a
// facet.
//
// Samples are sorted into the cells of bands of the Sun's view; each band is a task.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <vector>

#include "dem/stop_token.h"
#include "engine/support/packet.h"
#include "engine/support/pool.h"
#include "engine/visibility/zbuffer/raster_kernels.h"

namespace selenograph::engine {

// Sixteen surface points in light space.
struct LightLanes {
  alignas(64) float u[kPacket], v[kPacket], d[kPacket];
};

// Surface points that face the Sun, in light space, and the pixels that see them; structure of arrays, the first
// `count`.
struct LightSamples {
  std::vector<float> u, v, d;
  std::vector<std::uint32_t> pixel;
  std::vector<std::uint32_t> faces;  // of the Sun's disc, directions that the facet faces: a bit each
  std::size_t count = 0;
  float low[2], high[2];  // u, v: see bound()

  void make_room(std::size_t capacity, bool of_disc = false);
  void clear(std::size_t capacity, bool of_disc = false) { make_room(capacity, of_disc), count = 0; }
  // Before the sample is added that it is of.
  void add_face(std::int32_t bits) { faces[count] = static_cast<std::uint32_t>(bits); }
  void add_faces(const std::int32_t* bits) { std::copy_n(bits, kPacket, &faces[count]); }
  void add(float su, float sv, float sd, std::uint32_t at) {
    u[count] = su, v[count] = sv, d[count] = sd, pixel[count++] = at;
  }
  // Of pixels in a row.
  void add_all(const LightLanes& lanes, std::uint32_t first) {
    std::memcpy(&u[count], lanes.u, sizeof lanes.u), std::memcpy(&v[count], lanes.v, sizeof lanes.v);
    std::memcpy(&d[count], lanes.d, sizeof lanes.d);
    std::uint32_t* p = &pixel[count];
    for (std::uint32_t i = 0; i < kPacket; ++i) p[i] = first + i;
    count += kPacket;
  }
  // Sets low and high.
  void bound();
  std::size_t bytes() const {
    return 4 * (u.capacity() + v.capacity() + d.capacity() + pixel.capacity() + faces.capacity());
  }
};

// One band's samples in cells.
struct BandScratch {
  LightBand band;
  std::vector<std::uint32_t> cell, pixel;
  std::size_t bytes() const;
};

// A tile's samples, sixteen by sixteen as they lie there, by the bands that some of the sixteen are in: neighbours in
// the image, nearly all of them are in one.
struct BandGroups {
  std::vector<std::uint32_t> group;  // sample 16 group and those after it
  std::vector<std::uint32_t> first;  // of each band, in `group`; one more: the end
  std::vector<std::uint32_t> bands;  // while they are found: of each group the first, and how many more
};

// What a map needs while it works; kept from frame to frame.
struct LightScratch {
  Pool<BandScratch> bands;                           // one per thread
  std::vector<BandGroups> groups;                    // per tile
  std::vector<std::vector<std::uint32_t>> shadowed;  // pixels, per band
  std::size_t bytes() const;
};

class ShadowMap {
 public:
  // `sun`: unit, toward it.
  ShadowMap(const RasterMesh& mesh, const Vec3& sun);

  void place(const SurfacePoints& points, LightLanes& lanes) const;

  // Samples that were placed in another map of the same mesh, in this one: those that face one of the directions of
  // the mask.
  void turn(const ShadowMap& other, const LightSamples& placed, std::uint32_t mask, LightSamples& out) const;

  // The pixels of all samples in shadow, in any order, to scratch.shadowed. Parallel; stops between bands.
  void cast(const std::vector<LightSamples>& samples, LightScratch& scratch, const StopToken& stop) const;

 private:
  // A strip as seen from the Sun.
  struct Caster {
    float v_low, v_high, u_low, u_high, d_high;
    bool casts;  // some triangle may face away from the Sun: the others cast nothing
  };
  struct Grid;

  static Grid grid_over(const std::vector<LightSamples>& tiles);
  static void find_bands(const Grid& grid, const LightSamples& tile, BandGroups& out);
  static std::size_t sort_by_cell(const Grid& grid, std::size_t band, const std::vector<LightSamples>& tiles,
                                  const std::vector<BandGroups>& groups, BandScratch& own);
  Caster caster_of(const Strip& strip) const;
  bool may_face_away(const Strip& strip) const;
  void order_casters();
  void cast_strips(const Grid& grid, int band_index, LightBand& band) const;
  void cast_skirts(LightBand& band) const;

  const RasterMesh& mesh_;
  Vec3 u_, v_, d_;
  LightAxes axes_;
  std::vector<Caster> casters_;       // per strip
  std::vector<std::uint32_t> order_;  // in which they cast, those that do
  bool descending_ = false;           // in height toward the Sun
  struct Range {
    float low, high;
  };
  std::vector<Range> skirts_;  // in v
};

}  // namespace selenograph::engine
