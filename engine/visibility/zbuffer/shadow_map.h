// The irregular shadow map (Johnson, Lee, Burns, Mark: The irregular Z-buffer, ACM TOG 24(4), 2005): every surface
// point is a sample, and each shadow-casting triangle is tested against exactly the samples below it. It has no
// resolution and no bias: under a closed surface only facets that face away from the Sun need to cast, and a sunlit
// point never lies on such a facet.
//
// Light space, seen from the Sun (d points at the reader). Samples are sorted into cells; each band is a task:
//
//     v                                  /\           occluder: its box of cells is tested against the
//     ^  +----+----+----+----+----+     /  \          lowest sample of each run of kCoarse
//     |  |  . |.   |    | .  |    |    /____\         cells before its triangles are cast
//     |  | .  |    | .. |    |  . |   band 1: kBandRows rows of cells, about one sample (.) per cell,
//     |  +====+====+====+====+====+           each four times as high as wide
//     |  |    | .  |    |.   |    |   band 0: samples contiguous per row and per cell
//     +--+----+----+----+----+----+--> u
//
// For a solar disc the map is aimed slightly above the disc, and each band then finds the horizons in front of it: see
// horizons.h.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <vector>

#include "dem/base/pool.h"
#include "dem/base/stop_token.h"
#include "engine/support/packet.h"
#include "engine/visibility/points/disc_light.h"
#include "engine/visibility/zbuffer/horizons.h"
#include "engine/visibility/zbuffer/raster_kernels.h"
#include "engine/visibility/zbuffer/shadow_reach.h"

namespace selenograph::engine {

// Sixteen surface points in light space, metres. rest_*: what float rounds off the coordinates; set only for a solar
// disc.
struct LightLanes {
  alignas(64) float u[kPacket];
  alignas(64) float v[kPacket];
  alignas(64) float d[kPacket];
  alignas(64) float rest_u[kPacket];
  alignas(64) float rest_v[kPacket];
  alignas(64) float rest_d[kPacket];
};

// Data that samples need besides their position if the Sun is a disc; structure of arrays parallel to LightSamples,
// empty for a point Sun.
struct DiscSamples {
  std::vector<float> rest_u, rest_v, rest_d;  // rounding residuals, as in LightLanes
  // as in DiscLanes. For a sample that does not face the whole disc, tilt_across is NaN and the bits of tilt_upward are
  // its index in `grazed`.
  std::vector<float> tilt_across, tilt_upward;
  struct Grazed {
    float facet[3], shading[3];  // a DiscPlane each: middle, across, upward
  };
  std::vector<Grazed> grazed;
  // index in free_of_objects; kAllFree: no object hides a direction. Empty: no objects
  std::vector<std::uint32_t> free;
  static constexpr std::uint32_t kAllFree = ~0U;
  std::vector<DiscLight::FreeDirections> free_of_objects;

  void clear(std::size_t capacity, bool objects);
  void add(std::size_t at, const LightLanes& lanes, const DiscLanes& disc_lanes, std::size_t lane);
  // Adds a packet whose lanes all face the whole disc.
  void add_packet(std::size_t at, const LightLanes& lanes, const DiscLanes& disc_lanes);
  void get(std::size_t at, DiscLanes& disc_lanes, std::size_t lane) const;
  std::size_t bytes() const;
};
// Share of its unoccluded light that reaches the point of a pixel.
struct PartlyLit {
  std::uint32_t pixel;
  float share, cosine;  // as in DiscLight::remaining
};

// Surface points that face the Sun, in light space, and the pixels that see them; structure of arrays, `count` entries.
struct LightSamples {
  std::vector<float> u, v, d;
  std::vector<std::uint32_t> pixel;
  DiscSamples disc;
  std::size_t count = 0;
  float low[2], high[2];  // bounds of u and v, set by bound()

  void reserve(std::size_t capacity);
  void clear(std::size_t capacity) {
    reserve(capacity);
    count = 0;
  }
  void add(float su, float sv, float sd, std::uint32_t at) {
    u[count] = su;
    v[count] = sv;
    d[count] = sd;
    pixel[count++] = at;
  }
  // Adds a packet: sixteen pixels of a row from `first` on.
  void add_packet(const LightLanes& lanes, std::uint32_t first) {
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
  // For a solar disc, the origin of each sample: its tile, and its index there in the low bits.
  static constexpr int kIndexBits = 14;
  std::vector<std::uint32_t> origin;
  Horizons horizons;
  std::size_t bytes() const;
};

// Lists a tile's samples, in groups of sixteen, by the bands that they touch. A group's samples are neighbours in the
// image, so nearly every group is in a single band.
struct BandGroups {
  std::vector<std::uint32_t> group;  // index g: samples from 16 * g on
  std::vector<std::uint32_t> first;  // start of each band in `group`, and the end
  // Temporary, per group: the first band and, from bit 16 on, the number of further bands; 1 if a sample may be in
  // shadow.
  std::vector<std::uint32_t> bands;
  std::vector<std::uint8_t> reached;
};

// Scratch memory of a shadow map, reused from frame to frame.
struct LightScratch {
  Pool<BandScratch> bands;                           // one per thread
  std::vector<BandGroups> groups;                    // per tile
  std::vector<std::vector<std::uint32_t>> shadowed;  // shadowed pixels, per band
  std::vector<std::vector<PartlyLit>> partly;        // partly lit pixels, per band; only for a solar disc
  std::size_t bytes() const;
};

class ShadowMap {
 public:
  // For a point Sun. `sun`: unit vector toward it.
  ShadowMap(const RasterMesh& mesh, const Vec3& sun);
  // For a solar disc. `disc` must outlive this object.
  ShadowMap(const RasterMesh& mesh, const DiscLight& disc);

  // Direction from which shadows are cast.
  const Vec3& aim() const { return d_; }
  // Axes of light space: u, v and d.
  std::array<Vec3, 3> axes() const { return {u_, v_, d_}; }

  // Transforms points into light space, for a disc with rounding residuals.
  void place(const SurfacePoints& points, LightLanes& lanes) const;

  // Writes the pixels of all shadowed samples, in any order, to scratch.shadowed; for a disc, the partly lit ones to
  // scratch.partly. Parallel; checks `stop` before each band.
  void cast(const std::vector<LightSamples>& samples, LightScratch& scratch, const StopToken& stop) const;

 private:
  // The bounding box of a strip in light space.
  struct Occluder : LightBox {
    bool may_cast;  // a triangle may face away from the aim, and so cast a shadow
    bool horizon;   // a triangle may face away from part of the disc
  };
  struct Grid;

  ShadowMap(const RasterMesh& mesh, const Vec3& aim, const DiscLight* disc, double aim_radii);
  ShadowMap(const RasterMesh& mesh, const DiscLight& disc, double aim_radii);

  static Grid grid_over(const std::vector<LightSamples>& tiles);
  ShadowReach reach_over(const Grid& grid) const;
  std::vector<LightBox> occluder_boxes() const;
  // Lists the groups that may be in shadow. `reach`: null if all groups may be.
  static void find_bands(const Grid& grid, const LightSamples& tile, const ShadowReach* reach, BandGroups& out);
  std::size_t sort_by_cell(const Grid& grid, std::size_t band_index, const std::vector<LightSamples>& tiles,
                           const std::vector<BandGroups>& groups, BandScratch& scratch) const;
  static void lay_band(const Grid& grid, std::size_t band_index, LightBand& band);
  static bool count_per_cell(const Grid& grid, std::size_t band_index, const std::vector<LightSamples>& tiles,
                             const std::vector<BandGroups>& groups, BandScratch& scratch);
  static std::size_t sum_cell_counts(LightBand& band);
  void scatter_into_cells(std::size_t band_index, const std::vector<LightSamples>& tiles,
                          const std::vector<BandGroups>& groups, std::size_t count, BandScratch& scratch) const;
  Occluder occluder_of(const Strip& strip) const;
  bool may_face_away(const Strip& strip, const Vec3& from, double radius) const;
  void order_occluders();
  void cast_strips(const Grid& grid, int band_index, LightBand& band) const;
  void cast_skirts(LightBand& band) const;
  void find_horizons(const std::vector<LightSamples>& tiles, BandScratch& scratch, std::size_t count,
                     std::vector<PartlyLit>& out) const;

  const RasterMesh& mesh_;
  const DiscLight* disc_;  // null: point Sun
  double aim_radii_;       // aim above the middle of the disc, in its radii
  Vec3 u_, v_, d_;
  LightAxes axes_;
  std::vector<Occluder> occluders_;   // per strip
  std::vector<std::uint32_t> order_;  // strips that may cast, in casting order
  bool descending_ = false;           // order_ is by descending d_high
  std::vector<LightBox> skirts_;
};

}  // namespace selenograph::engine
