// The irregular shadow map (Johnson, Lee, Burns, Mark: The irregular Z-buffer, ACM TOG 24(4), 2005): every surface
// point is a sample, and each shadow-casting triangle is tested against exactly the samples below it. It has no
// resolution and no bias: under a closed surface only facets that face away from the Sun need to cast, and a sunlit
// point never lies on such a facet.
//
// Samples are sorted into cells of bands of light space; each band is a task. For a solar disc the map is aimed
// slightly above the disc, and each band then finds the horizons in front of it: see horizons.h.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/support/packet.h"
#include "engine/support/pool.h"
#include "engine/visibility/points/disc_light.h"
#include "engine/visibility/zbuffer/horizons.h"
#include "engine/visibility/zbuffer/raster_kernels.h"
#include "engine/visibility/zbuffer/shadow_reach.h"

namespace selenograph::engine {

// Sixteen surface points in light space; for a solar disc with the part of the coordinates that float rounds off.
struct LightLanes {
  alignas(64) float u[kPacket];
  alignas(64) float v[kPacket];
  alignas(64) float d[kPacket];
  alignas(64) float rest_u[kPacket];
  alignas(64) float rest_v[kPacket];
  alignas(64) float rest_d[kPacket];
};

// Samples with respect to the solar disc; structure of arrays like LightSamples, empty for a point Sun.
struct DiscSamples {
  std::vector<float> rest_u, rest_v, rest_d;    // as in LightLanes
  std::vector<float> tilt_across, tilt_upward;  // as in DiscLanes; of one that doesn't face all of the disc: not a
                                                // number, and its place in `grazed`
  struct Grazed {
    float facet[3], shading[3];  // DiscPlane of either: middle, across, upward
  };
  std::vector<Grazed> grazed;
  std::vector<std::uint32_t> free;  // directions that objects leave free, in of_objects; kAllFree: all.
                                    // Empty: all
  static constexpr std::uint32_t kAllFree = ~0U;
  std::vector<DiscLight::Free> of_objects;

  void clear(std::size_t capacity, bool objects);
  void add(std::size_t at, const LightLanes& lanes, const DiscLanes& turned, std::size_t lane);
  // Adds lanes that face the whole disc.
  void add_all(std::size_t at, const LightLanes& lanes, const DiscLanes& turned);
  void get(std::size_t at, DiscLanes& turned, std::size_t lane) const;
  std::size_t bytes() const;
};
// Remaining part of the light that a pixel's point would receive alone.
struct PartlyLit {
  std::uint32_t pixel;
  float share, cosine;  // as in DiscLight::left
};

// Surface points that face the Sun, in light space, and the pixels that see them; structure of arrays, `count` entries.
struct LightSamples {
  std::vector<float> u, v, d;
  std::vector<std::uint32_t> pixel;
  DiscSamples disc;
  std::size_t count = 0;
  float low[2], high[2];  // u, v: see bound()

  void make_room(std::size_t capacity);
  void clear(std::size_t capacity) { make_room(capacity), count = 0; }
  void add(float su, float sv, float sd, std::uint32_t at) {
    u[count] = su;
    v[count] = sv;
    d[count] = sd;
    pixel[count++] = at;
  }
  // Adds pixels of a row.
  void add_all(const LightLanes& lanes, std::uint32_t first) {
    std::memcpy(&u[count], lanes.u, sizeof lanes.u);
    std::memcpy(&v[count], lanes.v, sizeof lanes.v);
    std::memcpy(&d[count], lanes.d, sizeof lanes.d);
    std::uint32_t* p = &pixel[count];
    for (std::uint32_t i = 0; i < kPacket; ++i) p[i] = first + i;
    count += kPacket;
  }
  // Sets low and high.
  void bound();
  std::size_t bytes() const { return bytes_of(u) + bytes_of(v) + bytes_of(d) + bytes_of(pixel) + disc.bytes(); }
};

// One band's samples, sorted into cells.
struct BandScratch {
  LightBand band;
  std::vector<std::uint32_t> cell, pixel;
  // Origin of each sample: its tile and its place there. For a solar disc.
  static constexpr int kPlaceBits = 14;
  std::vector<std::uint32_t> from;
  Horizons horizons;
  std::size_t bytes() const;
};

// A tile's samples in groups of sixteen, listed by the bands that they touch: neighbours in the image, so nearly all
// groups are in one band.
struct BandGroups {
  std::vector<std::uint32_t> group;  // samples from 16 * group on
  std::vector<std::uint32_t> first;  // start of each band in `group`, plus the end
  // Temporary, per group: the first band and the number of further ones; whether a sample may be in shadow.
  std::vector<std::uint32_t> bands;
  std::vector<std::uint8_t> reached;
};

// Scratch memory of a shadow map, reused from frame to frame.
struct LightScratch {
  Pool<BandScratch> bands;                           // one per thread
  std::vector<BandGroups> groups;                    // per tile
  std::vector<std::vector<std::uint32_t>> shadowed;  // pixels, per band
  std::vector<std::vector<PartlyLit>> partly;        // partly lit pixels, per band: for a solar disc
  std::size_t bytes() const;
};

class ShadowMap {
 public:
  // `sun`: unit vector toward it.
  ShadowMap(const RasterMesh& mesh, const Vec3& sun);
  // For a solar disc, which must outlive this object.
  ShadowMap(const RasterMesh& mesh, const DiscLight& disc);

  // Direction that the map is aimed at: shadowed samples are shadowed from there.
  const Vec3& aim() const { return d_; }

  void place(const SurfacePoints& points, LightLanes& lanes) const;

  // Writes the pixels of all shadowed samples, in any order, to scratch.shadowed; for a disc, the partly lit ones to
  // scratch.partly. Parallel; stops between bands.
  void cast(const std::vector<LightSamples>& samples, LightScratch& scratch, const StopToken& stop) const;

 private:
  // A strip in light space.
  struct Caster : LightBox {
    bool casts;    // some triangle may face away from the Sun and so cast
    bool horizon;  // some triangle may be turned away from some of the disc
  };
  struct Grid;

  ShadowMap(const RasterMesh& mesh, const Vec3& aim, const DiscLight* disc, double aim_radii);
  ShadowMap(const RasterMesh& mesh, const DiscLight& disc, double aim_radii);

  static Grid grid_over(const std::vector<LightSamples>& tiles);
  ShadowReach reach_over(const Grid& grid) const;
  std::vector<LightBox> parts_of_casters() const;
  // Of the groups that may be in shadow; `reach`: null, all may be.
  static void find_bands(const Grid& grid, const LightSamples& tile, const ShadowReach* reach, BandGroups& out);
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
  double aim_radii_;       // aim above the disc's middle, in radii
  Vec3 u_, v_, d_;
  LightAxes axes_;
  std::vector<Caster> casters_;       // per strip
  std::vector<std::uint32_t> order_;  // casting strips, in casting order
  bool descending_ = false;           // in descending height toward the Sun
  std::vector<LightBox> skirts_;
};

}  // namespace selenograph::engine
