// The irregular shadow map (Johnson, Lee, Burns, Mark: The irregular Z-buffer, ACM TOG 24(4), 2005): every surface
// point is a sample, and each triangle that may shade is tested against exactly the samples beneath it. No resolution,
// no bias: under a closed surface only what faces away from the Sun needs to cast, and a point never lies on such a
// facet.
//
// Samples are sorted into the cells of bands of the Sun's view; each band is a task. For a Sun with a disc the map is
// aimed a little above it, and each band then finds the horizons before it: see horizons.h.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <vector>

#include "dem/support/stop_token.h"
#include "engine/support/packet.h"
#include "engine/support/pool.h"
#include "engine/visibility/points/disc_light.h"
#include "engine/visibility/zbuffer/horizons.h"
#include "engine/visibility/zbuffer/raster_kernels.h"

namespace selenograph::engine {

// Sixteen surface points in light space; of a Sun with a disc, what float leaves out of that.
struct LightLanes {
  alignas(64) float u[kPacket], v[kPacket], d[kPacket];
  alignas(64) float rest_u[kPacket], rest_v[kPacket], rest_d[kPacket];
};

// How samples lie before the Sun's disc; structure of arrays as LightSamples is, empty for a point Sun.
struct DiscSamples {
  std::vector<float> rest_u, rest_v, rest_d;    // as in LightLanes
  std::vector<float> tilt_across, tilt_upward;  // as in DiscLanes; of one that doesn't face all of the disc: not a
                                                // number, and its place in `grazed`
  struct Grazed {
    float facet[3], shading[3];  // DiscPlane of either: middle, across, upward
  };
  std::vector<Grazed> grazed;
  std::vector<std::uint32_t> free;  // what objects leave, in of_objects; kAllFree: nothing of theirs is in the way.
                                    // Empty: of all
  static constexpr std::uint32_t kAllFree = ~0U;
  std::vector<DiscLight::Free> of_objects;

  void clear(std::size_t capacity, bool objects);
  void add(std::size_t at, const LightLanes& lanes, const DiscLanes& turned, std::size_t lane);
  // That face all of the disc.
  void add_all(std::size_t at, const LightLanes& lanes, const DiscLanes& turned);
  void get(std::size_t at, DiscLanes& turned, std::size_t lane) const;
  std::size_t bytes() const;
};
// What is left of the light that a pixel's point would receive alone with the Sun's disc.
struct PartlyLit {
  std::uint32_t pixel;
  float share, cosine;  // as in DiscLight::left
};

// Surface points that face the Sun, in light space, and the pixels that see them; structure of arrays, the first
// `count`.
struct LightSamples {
  std::vector<float> u, v, d;
  std::vector<std::uint32_t> pixel;
  DiscSamples disc;
  std::size_t count = 0;
  float low[2], high[2];  // u, v: see bound()

  void make_room(std::size_t capacity);
  void clear(std::size_t capacity) { make_room(capacity), count = 0; }
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
  std::size_t bytes() const { return bytes_of(u) + bytes_of(v) + bytes_of(d) + bytes_of(pixel) + disc.bytes(); }
};

// One band's samples in cells.
struct BandScratch {
  LightBand band;
  std::vector<std::uint32_t> cell, pixel;
  // Of each sample, where it came from: its tile and its place there. For a Sun with a disc.
  static constexpr int kPlaceBits = 14;
  std::vector<std::uint32_t> from;
  Horizons horizons;
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
  std::vector<std::vector<PartlyLit>> partly;        // others, per band: of a Sun with a disc
  std::size_t bytes() const;
};

class ShadowMap {
 public:
  // `sun`: unit, toward it.
  ShadowMap(const RasterMesh& mesh, const Vec3& sun);
  // Of a disc, which outlives it.
  ShadowMap(const RasterMesh& mesh, const DiscLight& disc);

  // Where it is aimed: what is dark is so from there.
  const Vec3& aim() const { return d_; }

  void place(const SurfacePoints& points, LightLanes& lanes) const;

  // The pixels of all samples in shadow, in any order, to scratch.shadowed; of a disc, of those that see a part of it,
  // to scratch.partly. Parallel; stops between bands.
  void cast(const std::vector<LightSamples>& samples, LightScratch& scratch, const StopToken& stop) const;

 private:
  // A strip as seen from the Sun.
  struct Caster {
    float v_low, v_high, u_low, u_high, d_high;
    bool casts;    // some triangle may face away from the Sun: the others cast nothing
    bool horizon;  // some triangle may be turned away from some of the disc
  };
  struct Grid;

  ShadowMap(const RasterMesh& mesh, const Vec3& aim, const DiscLight* disc, double aim_radii);
  ShadowMap(const RasterMesh& mesh, const DiscLight& disc, double aim_radii);

  static Grid grid_over(const std::vector<LightSamples>& tiles);
  static void find_bands(const Grid& grid, const LightSamples& tile, BandGroups& out);
  std::size_t sort_by_cell(const Grid& grid, std::size_t band, const std::vector<LightSamples>& tiles,
                           const std::vector<BandGroups>& groups, BandScratch& own) const;
  Caster caster_of(const Strip& strip) const;
  bool may_face_away(const Strip& strip, const Vec3& from, double radius) const;
  void order_casters();
  void cast_strips(const Grid& grid, int band_index, LightBand& band) const;
  void cast_skirts(LightBand& band) const;
  void find_horizons(const std::vector<LightSamples>& tiles, BandScratch& own, std::size_t count,
                     std::vector<PartlyLit>& out) const;

  const RasterMesh& mesh_;
  const DiscLight* disc_;  // null: a point
  double aim_radii_;       // of the disc, above its middle
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
