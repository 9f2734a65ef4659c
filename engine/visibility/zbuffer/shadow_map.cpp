#include "engine/visibility/zbuffer/shadow_map.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <span>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/base/vector_targets.h"
#include "engine/visibility/points/trace.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/zbuffer/shadow_map.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_SHADOW_MAP_SHARED
#define SELENOGRAPH_ENGINE_SHADOW_MAP_SHARED
namespace selenograph::engine {

constexpr int kBandRows = 64;
constexpr std::size_t kBandPadding = 16;                         // vectors reach beyond the last sample
constexpr float kDark = std::numeric_limits<float>::infinity();  // instead of the d of a sample in shadow

// A band among the others, as BandsOf counts them.
struct BandOf {
  std::uint32_t index;
  float v0, bands_per_v, last;
};

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

void IntoLight(const SurfacePoints& p, const double* anchor, const double* u, const double* v, const double* d,
               LightLanes& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = p.x[i] - anchor[0], y = p.y[i] - anchor[1], z = p.z[i] - anchor[2];
    out.u[i] = static_cast<float>(u[0] * x + u[1] * y + u[2] * z);
    out.v[i] = static_cast<float>(v[0] * x + v[1] * y + v[2] * z);
    out.d[i] = static_cast<float>(d[0] * x + d[1] * y + d[2] * z);
  }
}

// And what float leaves out.
void IntoLightExactly(const SurfacePoints& p, const double* anchor, const double* u, const double* v, const double* d,
                      LightLanes& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = p.x[i] - anchor[0], y = p.y[i] - anchor[1], z = p.z[i] - anchor[2];
    const double at_u = u[0] * x + u[1] * y + u[2] * z;
    const double at_v = v[0] * x + v[1] * y + v[2] * z;
    const double at_d = d[0] * x + d[1] * y + d[2] * z;
    const auto near_u = static_cast<float>(at_u);
    const auto near_v = static_cast<float>(at_v);
    const auto near_d = static_cast<float>(at_d);
    out.u[i] = near_u;
    out.v[i] = near_v;
    out.d[i] = near_d;
    out.rest_u[i] = static_cast<float>(at_u - static_cast<double>(near_u));
    out.rest_v[i] = static_cast<float>(at_v - static_cast<double>(near_v));
    out.rest_d[i] = static_cast<float>(at_d - static_cast<double>(near_d));
  }
}

// Which band a sample is in. Rounding may put one that is on a border into either: the bands' margin allows for that.
HWY_INLINE std::uint32_t band_of(float v, float v0, float bands_per_v, float last) {
  const float at = (v - v0) * bands_per_v;
  const float low = at > 0 ? at : 0;
  // Towards zero, which is down.
  return static_cast<std::uint32_t>(static_cast<std::int32_t>(low < last ? low : last));
}

// Of sixteen samples each: the first of their bands and, from bit 16 on, how many more there are up to the last.
void BandsOf(const float* v, std::size_t groups, float v0, float bands_per_v, int bands, std::uint32_t* out) {
  const auto last = static_cast<float>(bands - 1);
  for (std::size_t g = 0; g < groups; ++g, v += kPacket) {
    std::uint32_t low = ~0U, high = 0;
    for (int i = 0; i < kPacket; ++i) {
      const std::uint32_t band = band_of(v[i], v0, bands_per_v, last);
      low = band < low ? band : low;
      high = band > high ? band : high;
    }
    out[g] = low | (high - low) << 16;
  }
}

// Cells of the samples of n groups of sixteen, or the one beyond all cells for those that are in another band.
void CellsOf(const LightSamples& tile, const std::uint32_t* groups, std::size_t n, const LightBand& band,
             const BandOf& where, std::uint32_t* out) {
  const float u0 = band.u0;
  const float v0 = band.v0;
  const float per_u = band.per_u;
  const float per_v = band.per_v;
  const int columns = band.columns;
  const auto last_column = static_cast<float>(columns - 1);
  const auto last_row = static_cast<float>(kBandRows - 1);
  const std::uint32_t own = where.index;
  const std::uint32_t none = static_cast<std::uint32_t>(columns) * kBandRows;
  const float first_v = where.v0, bands_per_v = where.bands_per_v, last = where.last;
  for (std::size_t g = 0; g < n; ++g, out += kPacket) {
    const std::size_t first = std::size_t{groups[g]} * kPacket, left = tile.count - first;
    const int here = left < kPacket ? static_cast<int>(left) : kPacket;
    const float *u = &tile.u[first], *v = &tile.v[first];
    SELENOGRAPH_INDEPENDENT_LANES
    for (int i = 0; i < kPacket; ++i) {
      float column = (u[i] - u0) * per_u;
      float row = (v[i] - v0) * per_v;
      column = column > 0 ? column : 0;
      row = row > 0 ? row : 0;
      column = column < last_column ? column : last_column;
      row = row < last_row ? row : last_row;
      const std::int32_t cell = static_cast<std::int32_t>(row) * columns + static_cast<std::int32_t>(column);
      const bool in_band = (band_of(v[i], first_v, bands_per_v, last) == own) & (i < here);
      out[i] = in_band ? static_cast<std::uint32_t>(cell) : none;
    }
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(IntoLight);
HWY_EXPORT(IntoLightExactly);
HWY_EXPORT(BandsOf);
HWY_EXPORT(CellsOf);

// Cells over all samples: u by columns, v by rows, of which kBandRows make a band.
struct ShadowMap::Grid {
  float u0, v0, per_u, per_v;
  int columns, bands;
  float bands_per_v() const { return per_v / kBandRows; }
  int rows() const { return bands * kBandRows; }
  int column_of(float u) const {
    return static_cast<int>(std::min(std::max(std::floor((u - u0) * per_u), 0.F), static_cast<float>(columns - 1)));
  }
  // Of the band that begins at v0 + band * kBandRows / per_v: as the kernel counts.
  float band_start(int band) const { return v0 + static_cast<float>(band) * (static_cast<float>(kBandRows) / per_v); }
  int row_in(int band, float v) const {
    return static_cast<int>(
        std::min(std::max(std::floor((v - band_start(band)) * per_v), 0.F), static_cast<float>(kBandRows - 1)));
  }
};

// About one sample a cell. Cells are four times as high as wide: a triangle then covers fewer rows, and more samples in
// each.
constexpr float kFlatness = 2;

ShadowMap::Grid ShadowMap::grid_over(const std::vector<LightSamples>& tiles) {
  constexpr float kInfinite = std::numeric_limits<float>::infinity();
  float u0 = kInfinite;
  float u1 = -kInfinite;
  float v0 = kInfinite;
  float v1 = -kInfinite;
  std::size_t n = 0;
  for (const LightSamples& t : tiles) {
    n += t.count;
    u0 = std::min(u0, t.low[0]);
    u1 = std::max(u1, t.high[0]);
    v0 = std::min(v0, t.low[1]);
    v1 = std::max(v1, t.high[1]);
  }
  Grid g{u0, v0, 1, 1, 1, 0};
  if (n == 0) return g;
  // A little room, and no axis shorter than a thousandth of the other.
  const float least = std::max(1e-3F * std::max(u1 - u0, v1 - v0), 1e-3F);
  const float across = std::max(u1 - u0, least) * 1.001F;
  const float along = std::max(v1 - v0, least) * 1.001F;
  const float cell = std::sqrt(across * along / static_cast<float>(n));
  g.columns = std::max(1, static_cast<int>(std::ceil(across / cell * kFlatness)));
  const int rows = std::max(1, static_cast<int>(std::ceil(along / cell / kFlatness)));
  g.bands = (rows + kBandRows - 1) / kBandRows;
  g.per_u = static_cast<float>(g.columns) / across;
  g.per_v = static_cast<float>(rows) / along;
  return g;
}

namespace {

float steepest_of(const Strip& s) { return *std::max_element(s.steepest, s.steepest + 8); }

// Raises the box by a margin for what float rounds off.
LightBox raised(LightBox box) {
  box.d_high += 1e-6F * std::abs(box.d_high);
  return box;
}

// Steeper terrain has horizons that are steeper in the sky.
double aim_over(const RasterMesh& mesh) {
  const auto steep = [](const Strip& s) { return std::isfinite(steepest_of(s)) && steepest_of(s) > Horizons::kSteep; };
  return std::any_of(mesh.strips().begin(), mesh.strips().end(), steep) ? Horizons::kSteepAim : Horizons::kAim;
}

}  // namespace

ShadowMap::ShadowMap(const RasterMesh& mesh, const Vec3& sun) : ShadowMap(mesh, sun, nullptr, 0) {}

ShadowMap::ShadowMap(const RasterMesh& mesh, const DiscLight& disc) : ShadowMap(mesh, disc, aim_over(mesh)) {}

ShadowMap::ShadowMap(const RasterMesh& mesh, const DiscLight& disc, double aim_radii)
    : ShadowMap(mesh, disc.direction(0, aim_radii), &disc, aim_radii) {}

ShadowMap::ShadowMap(const RasterMesh& mesh, const Vec3& aim, const DiscLight* disc, double aim_radii)
    : mesh_(mesh), disc_(disc), aim_radii_(aim_radii), d_(aim) {
  // Rows along the Sun's azimuth: relief moves samples along them.
  const Vec3 up = mesh.anchor().normalized(), across = up.cross(aim);
  v_ = across.norm() > 1e-6 ? across.normalized() : any_across(aim);
  u_ = v_.cross(aim).normalized();
  for (int k = 0; k < 3; ++k) {
    axes_.u[k] = static_cast<float>(u_[k]);
    axes_.v[k] = static_cast<float>(v_[k]);
    axes_.d[k] = static_cast<float>(d_[k]);
  }
  casters_.resize(mesh.strips().size());
  in_parallel(casters_.size(), [&](std::size_t i) { casters_[i] = caster_of(mesh.strips()[i]); });
  order_casters();
  for (const Skirt& skirt : mesh.skirts()) {
    const auto along = [&](const float* axis) {
      const auto at = [&](const float* p) { return axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]; };
      return std::minmax({at(skirt.a), at(skirt.b), at(skirt.c)});
    };
    const auto u = along(axes_.u);
    const auto v = along(axes_.v);
    const auto d = along(axes_.d);
    skirts_.push_back(raised({u.first, u.second, v.first, v.second, d.second}));
  }
}

ShadowMap::Caster ShadowMap::caster_of(const Strip& s) const {
  const auto range = [&](const float* axis, float& low, float& high) {
    float middle = 0, reach = 0;
    for (int k = 0; k < 3; ++k) middle += axis[k] * s.centre[k];
    for (const auto& half : s.half) reach += std::abs(axis[0] * half[0] + axis[1] * half[1] + axis[2] * half[2]);
    reach += 1e-6F * std::abs(middle);  // several times what float rounds off
    low = middle - reach;
    high = middle + reach;
  };
  Caster c{};
  float unused;
  range(axes_.u, c.u_low, c.u_high);
  range(axes_.v, c.v_low, c.v_high);
  range(axes_.d, unused, c.d_high);
  c.casts = may_face_away(s, d_, 0);
  c.horizon = disc_ && may_face_away(s, disc_->direction(0, 0), disc_->radius());
  return c;
}

// Whether some triangle may face away from some place on a disc: whose middle is `from`, and the tangent of its radius
// `radius`. A triangle faces away where it rises more steeply toward the Sun than the Sun does: more than the strip's
// steepest toward the two of eight directions that the Sun's lies between can't be. What triangles have as float is
// close enough to turn those that are nearly edge-on, no others.
bool ShadowMap::may_face_away(const Strip& s, const Vec3& from, double radius) const {
  double toward[3];
  double shortest = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 3; ++k) {
    const Vec3 half(static_cast<double>(s.half[k][0]), static_cast<double>(s.half[k][1]),
                    static_cast<double>(s.half[k][2]));
    const double length = half.norm();
    toward[k] = from.dot(half) / length;
    const int quads = k == 0 ? mesh_.blocks()[s.block].quads : s.rows;
    if (k < 2) shortest = std::min(shortest, 2 * length / quads);
  }
  const auto [east, north, up] = toward;
  const double along = std::abs(east);
  const double across = std::abs(north);
  const int axis = along >= across ? (east < 0 ? 4 : 0) : (north < 0 ? 6 : 2);
  const int diagonal = north < 0 ? (east < 0 ? 5 : 7) : (east < 0 ? 3 : 1);
  const auto first = static_cast<double>(s.steepest[axis]);
  const auto second = static_cast<double>(s.steepest[diagonal]);
  const double rise = std::abs(along - across) * first + std::numbers::sqrt2 * std::min(along, across) * second;
  const double distance =
      Vec3(static_cast<double>(s.centre[0]), static_cast<double>(s.centre[1]), static_cast<double>(s.centre[2])).norm();
  const double margin = 2e-4 + 0x1p-19 * distance / shortest;
  const double steepest = std::max(std::abs(first), std::abs(second));
  const double edge = radius * (1 + std::numbers::sqrt2 * std::max(steepest, static_cast<double>(steepest_of(s))));
  return !(rise + margin * (1 + steepest) + edge < up);
}

// At low Sun, occluders are processed in descending height toward it: the highest darken most, and what is dark needs
// no further test. (Measured: a tenth less at 3 degrees, a tenth more at 15, where the order in memory matters more.)
void ShadowMap::order_casters() {
  constexpr double kLow = 0.1;  // sine of the Sun's elevation: 6 degrees, between the two that were measured
  descending_ = mesh_.anchor().normalized().dot(d_) < kLow;
  for (std::uint32_t i = 0; i < casters_.size(); ++i)
    if (casters_[i].casts) order_.push_back(i);
  if (descending_)
    std::sort(order_.begin(), order_.end(),
              [&](std::uint32_t a, std::uint32_t b) { return casters_[a].d_high > casters_[b].d_high; });
}

namespace {

// Each by itself: where memory ran out for one of them, the others have grown already.
template <typename T>
void grow(std::vector<T>& values, std::size_t capacity) {
  if (values.size() < capacity) values.resize(capacity);
}

}  // namespace

void LightSamples::make_room(std::size_t capacity) {
  grow(u, capacity);
  grow(v, capacity);
  grow(d, capacity);
  grow(pixel, capacity);
}

void DiscSamples::clear(std::size_t capacity, bool objects) {
  for (auto* array : {&rest_u, &rest_v, &rest_d, &tilt_across, &tilt_upward}) grow(*array, capacity);
  grazed.clear();
  of_objects.clear();
  free.clear();
  if (objects) free.assign(capacity, kAllFree);
}

void DiscSamples::add(std::size_t at, const LightLanes& lanes, const DiscLanes& turned, std::size_t lane) {
  rest_u[at] = lanes.rest_u[lane];
  rest_v[at] = lanes.rest_v[lane];
  rest_d[at] = lanes.rest_d[lane];
  tilt_across[at] = turned.tilt_across[lane];
  tilt_upward[at] = turned.tilt_upward[lane];
  if (turned.whole >> lane & 1) return;
  tilt_across[at] = std::numeric_limits<float>::quiet_NaN();
  tilt_upward[at] = std::bit_cast<float>(static_cast<std::uint32_t>(grazed.size()));
  const DiscPlanes &f = turned.facet, &s = turned.shading;
  grazed.push_back(
      {{f.middle[lane], f.across[lane], f.upward[lane]}, {s.middle[lane], s.across[lane], s.upward[lane]}});
}

void DiscSamples::add_all(std::size_t at, const LightLanes& lanes, const DiscLanes& turned) {
  std::memcpy(&rest_u[at], lanes.rest_u, sizeof lanes.rest_u);
  std::memcpy(&rest_v[at], lanes.rest_v, sizeof lanes.rest_v);
  std::memcpy(&rest_d[at], lanes.rest_d, sizeof lanes.rest_d);
  std::memcpy(&tilt_across[at], turned.tilt_across, sizeof turned.tilt_across);
  std::memcpy(&tilt_upward[at], turned.tilt_upward, sizeof turned.tilt_upward);
}

void DiscSamples::get(std::size_t at, DiscLanes& turned, std::size_t lane) const {
  const float across = tilt_across[at], upward = tilt_upward[at];
  const bool whole = !std::isnan(across);
  const Grazed of = whole ? Grazed{{1, 0, 0}, {1, across, upward}} : grazed[std::bit_cast<std::uint32_t>(upward)];
  turned.facet.middle[lane] = of.facet[0];
  turned.facet.across[lane] = of.facet[1];
  turned.facet.upward[lane] = of.facet[2];
  turned.shading.middle[lane] = of.shading[0];
  turned.shading.across[lane] = of.shading[1];
  turned.shading.upward[lane] = of.shading[2];
  turned.tilt_across[lane] = across;
  turned.tilt_upward[lane] = upward;
  turned.whole = (turned.whole & ~(1U << lane)) | (whole ? 1U << lane : 0);
}

std::size_t DiscSamples::bytes() const {
  return bytes_of(rest_u) + bytes_of(rest_v) + bytes_of(rest_d) + bytes_of(tilt_across) + bytes_of(tilt_upward) +
         bytes_of(grazed) + bytes_of(free) + bytes_of(of_objects);
}

std::size_t BandScratch::bytes() const {
  return bytes_of(band.start) + bytes_of(band.u) + bytes_of(band.v) + bytes_of(band.d) + bytes_of(band.min_d) +
         bytes_of(cell) + bytes_of(pixel) + bytes_of(from) + horizons.bytes();
}

std::size_t LightScratch::bytes() const {
  std::size_t sum = bands.bytes();
  for (const BandGroups& g : groups)
    sum += bytes_of(g.group) + bytes_of(g.first) + bytes_of(g.bands) + bytes_of(g.reached);
  for (const auto& list : shadowed) sum += bytes_of(list);
  for (const auto& list : partly) sum += bytes_of(list);
  return sum;
}

void LightSamples::bound() {
  low[0] = low[1] = std::numeric_limits<float>::infinity();
  high[0] = high[1] = -low[0];
  if (count == 0) return;
  range_of(u.data(), count, low[0], high[0]);
  range_of(v.data(), count, low[1], high[1]);
}

void ShadowMap::place(const SurfacePoints& points, LightLanes& lanes) const {
  const auto into_light = disc_ ? HWY_DYNAMIC_DISPATCH(IntoLightExactly) : HWY_DYNAMIC_DISPATCH(IntoLight);
  into_light(points, mesh_.anchor().data(), u_.data(), v_.data(), d_.data(), lanes);
}

// Bounds casters by parts of strips unless there are more quads than cells (about one a sample): then the parts take
// longer to find than they save. (Measured at 15 degrees: Hadley, ten samples a quad, half the time for all of the
// map; the sample terrain, 0.7 samples a quad, the same.)
ShadowReach ShadowMap::reach_over(const Grid& grid) const {
  std::size_t quads = 0;
  for (const std::uint32_t caster : order_) {
    const Strip& strip = mesh_.strips()[caster];
    quads += static_cast<std::size_t>(strip.rows) * static_cast<std::size_t>(mesh_.blocks()[strip.block].quads);
  }
  const bool by_parts = quads <= static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows());
  const int side = by_parts ? 4 : 16;  // of the reach's cells, in the grid's
  ShadowReach reach(grid.u0, grid.v0, grid.per_u / static_cast<float>(side), grid.per_v / static_cast<float>(side),
                    grid.columns / side + 1, grid.rows() / side);
  if (by_parts) {
    for (const LightBox& part : parts_of_casters()) reach.add(part);
  } else {
    for (const std::uint32_t caster : order_) reach.add(casters_[caster]);
  }
  for (const LightBox& skirt : skirts_) reach.add(skirt);
  return reach;
}

// Returns bounds of the parts of strips that have triangles facing away from the Sun, in no particular order.
std::vector<LightBox> ShadowMap::parts_of_casters() const {
  return gathered_in_parallel<LightBox>(order_.size(), 16, [&](std::size_t i, std::vector<LightBox>& parts) {
    const Strip& strip = mesh_.strips()[order_[i]];
    LightBox boxes[kMaxOccluderBoxes];
    const std::size_t count = bound_occluders(mesh_.blocks()[strip.block], strip, axes_, boxes);
    for (const LightBox& box : std::span(boxes, count)) parts.push_back(raised(box));
  });
}

void ShadowMap::find_bands(const Grid& grid, const LightSamples& tile, const ShadowReach* reach, BandGroups& out) {
  const auto bands = static_cast<std::size_t>(grid.bands);
  const std::size_t whole = tile.count / kPacket;
  const std::size_t groups = (tile.count + kPacket - 1) / kPacket;
  out.bands.resize(groups);
  HWY_DYNAMIC_DISPATCH(BandsOf)(tile.v.data(), whole, grid.v0, grid.bands_per_v(), grid.bands, out.bands.data());
  if (groups > whole) out.bands[whole] = static_cast<std::uint32_t>(bands - 1) << 16;  // any: its samples are looked at
  out.reached.assign(groups, 1);
  if (reach) reach->find_reached(tile.u.data(), tile.v.data(), tile.d.data(), whole, out.reached.data());
  out.first.assign(bands + 1, 0);
  const auto for_bands = [&](std::size_t g, const auto& work) {
    if (!out.reached[g]) return;
    const std::uint32_t low = out.bands[g] & 0xffff, more = out.bands[g] >> 16;
    for (std::uint32_t b = low; b <= low + more; ++b) work(b);
  };
  for (std::size_t g = 0; g < groups; ++g) for_bands(g, [&](std::uint32_t b) { ++out.first[b]; });
  std::uint32_t end = 0;
  for (std::uint32_t& first : out.first) first = end += first;
  out.group.resize(end);
  // Backwards: each band's end goes down to its first.
  for (std::size_t g = groups; g-- > 0;)
    for_bands(g, [&](std::uint32_t b) { out.group[--out.first[b]] = static_cast<std::uint32_t>(g); });
}

// Fills own.band and own.pixel from all tiles' samples of the band. Returns how many there are.
std::size_t ShadowMap::sort_by_cell(const Grid& grid, std::size_t band_index, const std::vector<LightSamples>& tiles,
                                    const std::vector<BandGroups>& groups, BandScratch& own) const {
  LightBand& band = own.band;
  band.u0 = grid.u0;
  band.v0 = grid.band_start(static_cast<int>(band_index));
  band.per_u = grid.per_u;
  band.per_v = grid.per_v;
  band.columns = grid.columns;
  band.rows = kBandRows;
  // Eight units in the last place of the largest coordinate.
  band.margin_m =
      0x1p-20F * std::max({std::abs(band.u0), std::abs(band.u_end()), std::abs(band.v0), std::abs(band.v_end())});

  std::size_t lanes = 0;
  for (const BandGroups& g : groups) lanes += kPacket * (g.first[band_index + 1] - g.first[band_index]);
  if (lanes == 0) return 0;
  own.cell.resize(lanes);
  const BandOf where{static_cast<std::uint32_t>(band_index), grid.v0, grid.bands_per_v(),
                     static_cast<float>(grid.bands - 1)};
  std::uint32_t* cell = own.cell.data();
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    const std::uint32_t first = groups[i].first[band_index], n = groups[i].first[band_index + 1] - first;
    HWY_DYNAMIC_DISPATCH(CellsOf)(tiles[i], groups[i].group.data() + first, n, band, where, cell);
    cell += std::size_t{n} * kPacket;
  }
  const std::size_t cells = static_cast<std::size_t>(grid.columns) * kBandRows;
  band.start.assign(cells + 1, 0);
  std::uint32_t* start = band.start.data();
  for (std::size_t k = 0; k < lanes; ++k) ++start[own.cell[k]];
  // Each cell's end, which goes down to its first sample as samples are put there.
  std::uint32_t end = 0;
  for (std::size_t c = 0; c < cells; ++c) start[c] = end += start[c];
  start[cells] = end;
  const std::size_t count = end;
  own.pixel.resize(count);
  band.u.resize(count + kBandPadding);
  band.v.resize(count + kBandPadding);
  band.d.resize(count + kBandPadding);
  for (std::size_t i = count; i < count + kBandPadding; ++i) {
    band.u[i] = band.v[i] = 0;
    band.d[i] = kDark;
  }
  float *u = band.u.data(), *v = band.v.data(), *d = band.d.data();
  std::uint32_t* pixel = own.pixel.data();
  if (disc_) own.from.resize(count);
  std::uint32_t* from_where = disc_ ? own.from.data() : nullptr;
  cell = own.cell.data();
  for (std::size_t i = 0; i < tiles.size(); ++i)
    for (std::uint32_t k = groups[i].first[band_index]; k < groups[i].first[band_index + 1]; ++k) {
      const std::size_t first = std::size_t{groups[i].group[k]} * kPacket;
      for (std::size_t from = first; from < first + kPacket; ++from, ++cell) {
        if (*cell == cells) continue;
        const std::uint32_t to = --start[*cell];
        u[to] = tiles[i].u[from];
        v[to] = tiles[i].v[from];
        d[to] = tiles[i].d[from];
        pixel[to] = tiles[i].pixel[from];
        if (from_where)
          from_where[to] = static_cast<std::uint32_t>(i) << BandScratch::kPlaceBits | static_cast<std::uint32_t>(from);
      }
    }
  band.coarse_columns = (grid.columns + LightBand::kCoarse - 1) / LightBand::kCoarse;
  band.min_d.resize(static_cast<std::size_t>(band.coarse_columns) * kBandRows);
  update_coarse_min(band, 0, grid.columns - 1, 0, kBandRows - 1);
  return count;
}

void ShadowMap::cast_strips(const Grid& grid, int band_index, LightBand& band) const {
  const float lowest = *std::min_element(band.min_d.begin(), band.min_d.end());
  const float u_first = band.u0 - band.margin_m;
  const float u_last = band.u_end() + band.margin_m;
  const float v_first = band.v0 - band.margin_m;
  const float v_last = band.v_end() + band.margin_m;
  for (const std::uint32_t s : order_) {
    const Caster& c = casters_[s];
    if (!(c.d_high > lowest)) {
      if (descending_) break;
      continue;
    }
    if (c.v_high < v_first || c.v_low > v_last || c.u_high < u_first || c.u_low > u_last) continue;
    const int c0 = grid.column_of(c.u_low);
    const int c1 = grid.column_of(c.u_high);
    const int r0 = grid.row_in(band_index, c.v_low);
    const int r1 = grid.row_in(band_index, c.v_high);
    if (!band.any_below(c0, c1, r0, r1, c.d_high)) continue;
    const Strip& strip = mesh_.strips()[s];
    cast_strip(mesh_.blocks()[strip.block], strip, axes_, band);
    if (descending_) update_coarse_min(band, c0, c1, r0, r1);
  }
}

void ShadowMap::cast_skirts(LightBand& band) const {
  const float u_first = band.u0 - band.margin_m;
  const float u_last = band.u_end() + band.margin_m;
  const float v_first = band.v0 - band.margin_m;
  const float v_last = band.v_end() + band.margin_m;
  for (std::size_t k = 0; k < skirts_.size(); ++k) {
    const LightBox& s = skirts_[k];
    if (s.v_high < v_first || s.v_low > v_last || s.u_high < u_first || s.u_low > u_last) continue;
    cast_skirt(mesh_.skirts()[k], axes_, band);
  }
}

// Of the band's samples that are not dark.
void ShadowMap::find_horizons(const std::vector<LightSamples>& tiles, BandScratch& own, std::size_t count,
                              std::vector<PartlyLit>& out) const {
  LightBand& band = own.band;
  struct Place {
    const DiscSamples& tile;
    std::size_t at;
  };
  const auto place = [&](std::size_t sample) -> Place {
    constexpr std::uint32_t kMask = (1U << BandScratch::kPlaceBits) - 1;
    return {tiles[own.from[sample] >> BandScratch::kPlaceBits].disc, own.from[sample] & kMask};
  };
  if (!descending_) update_coarse_min(band, 0, band.columns - 1, 0, band.rows - 1);
  own.horizons.begin(*disc_, aim_radii_, {u_, v_, d_}, band, count, [&](std::size_t sample) -> LightResidual {
    const auto [tile, at] = place(sample);
    return {tile.rest_u[at], tile.rest_v[at], tile.rest_d[at]};
  });
  for (std::size_t s = 0; s < casters_.size(); ++s) {
    const Caster& c = casters_[s];
    if (c.horizon) own.horizons.add(mesh_, mesh_.strips()[s], c);
  }
  constexpr std::size_t kGroup = HorizonGroup::kSize;
  static_assert(kGroup == kPacket);
  alignas(64) float horizons[DiscLight::kColumns][kGroup];
  alignas(64) float share[kGroup];
  alignas(64) float cosine[kGroup];
  DiscLanes turned{};
  for (std::size_t first = 0; first < count; first += kGroup) {
    if (!own.horizons.of_group(first / kGroup, horizons)) continue;
    const std::size_t n = std::min(kGroup, count - first);
    for (std::size_t i = 0; i < kGroup; ++i) {
      const auto [tile, at] = place(first + std::min(i, n - 1));
      tile.get(at, turned, i);
    }
    disc_->left(horizons, turned, share, cosine);
    for (std::size_t i = 0; i < n; ++i) {
      if (band.d[first + i] == kDark) continue;
      const auto [tile, at] = place(first + i);
      if (!tile.free.empty() && tile.free[at] != DiscSamples::kAllFree) {
        const DiscShare left = disc_->left_of(tile.of_objects[tile.free[at]], &horizons[0][i], kGroup, turned,
                                              static_cast<std::uint32_t>(i));
        share[i] = static_cast<float>(left.share);
        cosine[i] = static_cast<float>(left.cosine);
      }
      if (share[i] < 1 || cosine[i] < 1) out.push_back({own.pixel[first + i], share[i], cosine[i]});
    }
  }
}

void ShadowMap::cast(const std::vector<LightSamples>& samples, LightScratch& scratch, const StopToken& stop) const {
  const Grid grid = grid_over(samples);
  const auto bands = static_cast<std::size_t>(grid.bands);
  if (scratch.shadowed.size() < bands) scratch.shadowed.resize(bands);
  if (disc_ && scratch.partly.size() < scratch.shadowed.size()) scratch.partly.resize(scratch.shadowed.size());
  for (auto& list : scratch.shadowed) list.clear();
  for (auto& list : scratch.partly) list.clear();
  if (bands == 0) return;
  scratch.groups.resize(samples.size());
  // The horizons of a disc reach farther than what hides all of it.
  std::optional<ShadowReach> reach;
  if (!disc_) reach = reach_over(grid);
  in_parallel(samples.size(),
              [&](std::size_t i) { find_bands(grid, samples[i], reach ? &*reach : nullptr, scratch.groups[i]); });
  in_parallel(bands, [&](std::size_t b) {
    stop.check();
    const Pool<BandScratch>::Lease own(scratch.bands);
    const std::size_t count = sort_by_cell(grid, b, samples, scratch.groups, *own);
    if (count == 0) return;
    cast_strips(grid, static_cast<int>(b), own->band);
    cast_skirts(own->band);
    for (std::size_t i = 0; i < count; ++i)
      if (own->band.d[i] == kDark) scratch.shadowed[b].push_back(own->pixel[i]);
    if (disc_) find_horizons(samples, *own, count, scratch.partly[b]);
  });
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
