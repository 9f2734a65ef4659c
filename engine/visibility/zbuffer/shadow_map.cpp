#include "engine/visibility/zbuffer/shadow_map.h"

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
constexpr std::size_t kBandPadding = 16;                         // vectors of samples are loaded past the last
constexpr float kDark = std::numeric_limits<float>::infinity();  // d of a sample in shadow

// Position of a band among all bands, as BandsOf counts them.
struct BandLayout {
  std::uint32_t index;
  float v0, bands_per_v, last;
};

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Sets the coordinates of sixteen points in light space, whose origin is the anchor. `u`, `v`, `d`: its axes.
void ToLightSpace(const SurfacePoints& p, const double* anchor, const double* u, const double* v, const double* d,
                  LightLanes& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = p.x[i] - anchor[0], y = p.y[i] - anchor[1], z = p.z[i] - anchor[2];
    out.u[i] = static_cast<float>(u[0] * x + u[1] * y + u[2] * z);
    out.v[i] = static_cast<float>(v[0] * x + v[1] * y + v[2] * z);
    out.d[i] = static_cast<float>(d[0] * x + d[1] * y + d[2] * z);
  }
}

// Transforms as ToLightSpace does, and stores what float rounds off.
void ToLightSpaceExactly(const SurfacePoints& p, const double* anchor, const double* u, const double* v,
                         const double* d, LightLanes& out) {
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

// Returns the band of a sample. Rounding may assign a sample on a border to either band: the margin of bands
// (LightBand::margin_m) allows for that.
HWY_INLINE std::uint32_t band_of(float v, float v0, float bands_per_v, float last) {
  const float at = (v - v0) * bands_per_v;
  const float low = at > 0 ? at : 0;
  // Convert toward zero, which rounds down.
  return static_cast<std::uint32_t>(static_cast<std::int32_t>(low < last ? low : last));
}

// Sets out[g] to the first band of a group of sixteen samples and, from bit 16 on, the number of further bands up to
// the last.
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

// Sets `out` to the cells of the samples of n groups of sixteen; samples in other bands get the index past the last
// cell.
void CellsOf(const LightSamples& tile, const std::uint32_t* groups, std::size_t n, const LightBand& band,
             const BandLayout& layout, std::uint32_t* out) {
  const float u0 = band.u0;
  const float v0 = band.v0;
  const float per_u = band.per_u;
  const float per_v = band.per_v;
  const int columns = band.columns;
  const auto last_column = static_cast<float>(columns - 1);
  const auto last_row = static_cast<float>(kBandRows - 1);
  const std::uint32_t own_band = layout.index;
  const std::uint32_t no_cell = static_cast<std::uint32_t>(columns) * kBandRows;
  const float first_v = layout.v0, bands_per_v = layout.bands_per_v, last = layout.last;
  for (std::size_t g = 0; g < n; ++g, out += kPacket) {
    const std::size_t first = std::size_t{groups[g]} * kPacket, remaining = tile.count - first;
    const int count = remaining < kPacket ? static_cast<int>(remaining) : kPacket;
    const float *u = &tile.u[first], *v = &tile.v[first];
    // Compute all lanes, also those beyond the tile's last sample, so that the loop has a constant length.
    SELENOGRAPH_INDEPENDENT_LANES
    for (int i = 0; i < kPacket; ++i) {
      float column = (u[i] - u0) * per_u;
      float row = (v[i] - v0) * per_v;
      column = column > 0 ? column : 0;
      row = row > 0 ? row : 0;
      column = column < last_column ? column : last_column;
      row = row < last_row ? row : last_row;
      const std::int32_t cell = static_cast<std::int32_t>(row) * columns + static_cast<std::int32_t>(column);
      const bool in_band = (band_of(v[i], first_v, bands_per_v, last) == own_band) & (i < count);
      out[i] = in_band ? static_cast<std::uint32_t>(cell) : no_cell;
    }
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(ToLightSpace);
HWY_EXPORT(ToLightSpaceExactly);
HWY_EXPORT(BandsOf);
HWY_EXPORT(CellsOf);

// Cells over all samples: columns along u, rows along v. kBandRows rows make a band.
struct ShadowMap::Grid {
  float u0, v0, per_u, per_v;
  int columns, bands;
  float bands_per_v() const { return per_v / kBandRows; }
  int rows() const { return bands * kBandRows; }
  int column_of(float u) const {
    return static_cast<int>(std::min(std::max(std::floor((u - u0) * per_u), 0.F), static_cast<float>(columns - 1)));
  }
  // Returns the start of a band in v, rounded as in the kernels.
  float band_start(int band) const { return v0 + static_cast<float>(band) * (static_cast<float>(kBandRows) / per_v); }
  int row_in(int band, float v) const {
    return static_cast<int>(
        std::min(std::max(std::floor((v - band_start(band)) * per_v), 0.F), static_cast<float>(kBandRows - 1)));
  }
};

namespace {

std::size_t cells_of(const LightBand& band) { return static_cast<std::size_t>(band.columns) * kBandRows; }

}  // namespace

// Square root of the height of a cell relative to its width. Cells are four times as high as wide: a triangle then
// covers fewer rows of cells and more samples in each.
constexpr float kFlatness = 2;

// Returns a grid over the samples of all tiles, with about one sample per cell; without bands if there are no samples.
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
  // Enlarge the grid by a thousandth, and let no axis be shorter than a thousandth of the other.
  const float min_extent = std::max(1e-3F * std::max(u1 - u0, v1 - v0), 1e-3F);
  const float extent_u = std::max(u1 - u0, min_extent) * 1.001F;
  const float extent_v = std::max(v1 - v0, min_extent) * 1.001F;
  const float cell_side = std::sqrt(extent_u * extent_v / static_cast<float>(n));
  g.columns = std::max(1, static_cast<int>(std::ceil(extent_u / cell_side * kFlatness)));
  const int rows = std::max(1, static_cast<int>(std::ceil(extent_v / cell_side / kFlatness)));
  g.bands = (rows + kBandRows - 1) / kBandRows;
  g.per_u = static_cast<float>(g.columns) / extent_u;
  g.per_v = static_cast<float>(rows) / extent_v;
  return g;
}

namespace {

float steepest_of(const Strip& s) { return *std::max_element(s.steepest, s.steepest + 8); }

// Raises the top of a box by several times the rounding error of d.
LightBox with_rounding_margin(LightBox box) {
  box.d_high += 1e-6F * std::abs(box.d_high);
  return box;
}

// Returns the aim in radii above the middle of the disc. Steep terrain has horizons that are steeper in the sky, which
// need a higher aim.
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
  // Let v run across the azimuth of the Sun, and u along it: relief displaces samples along u, within a row.
  const Vec3 up = mesh.anchor().normalized(), across = up.cross(aim);
  v_ = across.norm() > 1e-6 ? across.normalized() : any_across(aim);
  u_ = v_.cross(aim).normalized();
  for (int k = 0; k < 3; ++k) {
    axes_.u[k] = static_cast<float>(u_[k]);
    axes_.v[k] = static_cast<float>(v_[k]);
    axes_.d[k] = static_cast<float>(d_[k]);
  }
  occluders_.resize(mesh.strips().size());
  in_parallel(occluders_.size(), [&](std::size_t i) { occluders_[i] = occluder_of(mesh.strips()[i]); });
  order_occluders();
  for (const Skirt& skirt : mesh.skirts()) {
    const auto range_along = [&](const float* axis) {
      const auto dot = [&](const float* p) { return axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]; };
      return std::minmax({dot(skirt.a), dot(skirt.b), dot(skirt.c)});
    };
    const auto u = range_along(axes_.u);
    const auto v = range_along(axes_.v);
    const auto d = range_along(axes_.d);
    skirts_.push_back(with_rounding_margin({u.first, u.second, v.first, v.second, d.second}));
  }
}

// Returns the bounding box of a strip in light space, from its oriented box, and the ways in which it occludes.
ShadowMap::Occluder ShadowMap::occluder_of(const Strip& s) const {
  const auto range = [&](const float* axis, float& low, float& high) {
    float middle = 0, reach = 0;
    for (int k = 0; k < 3; ++k) middle += axis[k] * s.centre[k];
    for (const auto& half : s.half) reach += std::abs(axis[0] * half[0] + axis[1] * half[1] + axis[2] * half[2]);
    reach += 1e-6F * std::abs(middle);  // several times the rounding error
    low = middle - reach;
    high = middle + reach;
  };
  Occluder occluder{};
  float unused;
  range(axes_.u, occluder.u_low, occluder.u_high);
  range(axes_.v, occluder.v_low, occluder.v_high);
  range(axes_.d, unused, occluder.d_high);
  occluder.may_cast = may_face_away(s, d_, 0);
  occluder.horizon = disc_ && may_face_away(s, disc_->direction(0, 0), disc_->radius());
  return occluder;
}

// Returns false only if no triangle of the strip faces away from any point of a disc with its middle at `from` and a
// radius of tangent `radius`. A triangle faces away where the ground rises more steeply toward the Sun than the Sun is
// high. Strips store the steepest rise in eight directions, and the two that enclose the Sun's azimuth bound the rise
// toward it. The margin covers triangles whose float vertices turn them away although they are nearly edge-on.
bool ShadowMap::may_face_away(const Strip& s, const Vec3& from, double radius) const {
  double toward[3];  // components of `from` along the strip's own axes: east, north, up
  double shortest = std::numeric_limits<double>::infinity();  // shorter side of its quads, m
  for (int k = 0; k < 3; ++k) {
    const Vec3 half(static_cast<double>(s.half[k][0]), static_cast<double>(s.half[k][1]),
                    static_cast<double>(s.half[k][2]));
    const double length = half.norm();
    toward[k] = from.dot(half) / length;
    const int quads = k == 0 ? mesh_.blocks()[s.block].quads : s.rows;
    if (k < 2) shortest = std::min(shortest, 2 * length / quads);
  }
  const auto [east, north, up] = toward;
  const double eastward = std::abs(east);
  const double northward = std::abs(north);
  // Split the horizontal component into one along an axis and one along a diagonal. Strip::steepest counts directions
  // counter-clockwise from east, every 45 degrees.
  const int axis = eastward >= northward ? (east < 0 ? 4 : 0) : (north < 0 ? 6 : 2);
  const int diagonal = north < 0 ? (east < 0 ? 5 : 7) : (east < 0 ? 3 : 1);
  const auto axis_rise = static_cast<double>(s.steepest[axis]);
  const auto diagonal_rise = static_cast<double>(s.steepest[diagonal]);
  const double rise =
      std::abs(eastward - northward) * axis_rise + std::numbers::sqrt2 * std::min(eastward, northward) * diagonal_rise;
  const double distance =
      Vec3(static_cast<double>(s.centre[0]), static_cast<double>(s.centre[1]), static_cast<double>(s.centre[2])).norm();
  const double margin = 2e-4 + 0x1p-19 * distance / shortest;
  const double steepest = std::max(std::abs(axis_rise), std::abs(diagonal_rise));
  // Bound how much more the ground may rise toward another point of the disc, or that point be lower.
  const double disc_margin =
      radius * (1 + std::numbers::sqrt2 * std::max(steepest, static_cast<double>(steepest_of(s))));
  return !(rise + margin * (1 + steepest) + disc_margin < up);
}

// Orders the occluders. At low Sun they are cast by descending height: the highest darken most samples, and dark
// samples need no further test. (Measured: a tenth less time at 3 degrees; a tenth more at 15, where the order in
// memory matters more.)
void ShadowMap::order_occluders() {
  constexpr double kLow = 0.1;  // sine of the elevation of the Sun: 6 degrees, between the two measurements
  descending_ = mesh_.anchor().normalized().dot(d_) < kLow;
  for (std::uint32_t i = 0; i < occluders_.size(); ++i)
    if (occluders_[i].may_cast) order_.push_back(i);
  if (descending_)
    std::sort(order_.begin(), order_.end(),
              [&](std::uint32_t a, std::uint32_t b) { return occluders_[a].d_high > occluders_[b].d_high; });
}

namespace {

// Grows one array. Arrays of a set grow one by one: if memory ran out earlier, some may already be larger.
template <typename T>
void grow(std::vector<T>& values, std::size_t capacity) {
  if (values.size() < capacity) values.resize(capacity);
}

}  // namespace

void LightSamples::reserve(std::size_t capacity) {
  grow(u, capacity);
  grow(v, capacity);
  grow(d, capacity);
  grow(pixel, capacity);
}

void DiscSamples::clear(std::size_t capacity, bool objects) {
  for (auto* array : {&rest_u, &rest_v, &rest_d, &tilt_across, &tilt_upward}) grow(*array, capacity);
  grazed.clear();
  free_of_objects.clear();
  free.clear();
  if (objects) free.assign(capacity, kAllFree);
}

// Stores one lane as sample `at`. If it does not face the whole disc, NaN and an index replace its tilt.
void DiscSamples::add(std::size_t at, const LightLanes& lanes, const DiscLanes& disc_lanes, std::size_t lane) {
  rest_u[at] = lanes.rest_u[lane];
  rest_v[at] = lanes.rest_v[lane];
  rest_d[at] = lanes.rest_d[lane];
  tilt_across[at] = disc_lanes.tilt_across[lane];
  tilt_upward[at] = disc_lanes.tilt_upward[lane];
  if (disc_lanes.facing_all >> lane & 1) return;
  tilt_across[at] = std::numeric_limits<float>::quiet_NaN();
  tilt_upward[at] = std::bit_cast<float>(static_cast<std::uint32_t>(grazed.size()));
  const DiscPlanes &f = disc_lanes.facet, &s = disc_lanes.shading;
  grazed.push_back(
      {{f.middle[lane], f.across[lane], f.upward[lane]}, {s.middle[lane], s.across[lane], s.upward[lane]}});
}

void DiscSamples::add_packet(std::size_t at, const LightLanes& lanes, const DiscLanes& disc_lanes) {
  std::memcpy(&rest_u[at], lanes.rest_u, sizeof lanes.rest_u);
  std::memcpy(&rest_v[at], lanes.rest_v, sizeof lanes.rest_v);
  std::memcpy(&rest_d[at], lanes.rest_d, sizeof lanes.rest_d);
  std::memcpy(&tilt_across[at], disc_lanes.tilt_across, sizeof disc_lanes.tilt_across);
  std::memcpy(&tilt_upward[at], disc_lanes.tilt_upward, sizeof disc_lanes.tilt_upward);
}

// Restores sample `at` to a lane: the inverse of add().
void DiscSamples::get(std::size_t at, DiscLanes& disc_lanes, std::size_t lane) const {
  const float across = tilt_across[at], upward = tilt_upward[at];
  const bool faces_all = !std::isnan(across);
  const Grazed planes =
      faces_all ? Grazed{{1, 0, 0}, {1, across, upward}} : grazed[std::bit_cast<std::uint32_t>(upward)];
  disc_lanes.facet.middle[lane] = planes.facet[0];
  disc_lanes.facet.across[lane] = planes.facet[1];
  disc_lanes.facet.upward[lane] = planes.facet[2];
  disc_lanes.shading.middle[lane] = planes.shading[0];
  disc_lanes.shading.across[lane] = planes.shading[1];
  disc_lanes.shading.upward[lane] = planes.shading[2];
  disc_lanes.tilt_across[lane] = across;
  disc_lanes.tilt_upward[lane] = upward;
  disc_lanes.facing_all = (disc_lanes.facing_all & ~(1U << lane)) | (faces_all ? 1U << lane : 0);
}

std::size_t DiscSamples::bytes() const {
  return bytes_of(rest_u) + bytes_of(rest_v) + bytes_of(rest_d) + bytes_of(tilt_across) + bytes_of(tilt_upward) +
         bytes_of(grazed) + bytes_of(free) + bytes_of(free_of_objects);
}

std::size_t BandScratch::bytes() const {
  return bytes_of(band.start) + bytes_of(band.u) + bytes_of(band.v) + bytes_of(band.d) + bytes_of(band.min_d) +
         bytes_of(cell) + bytes_of(pixel) + bytes_of(origin) + horizons.bytes();
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
  const auto to_light_space = disc_ ? HWY_DYNAMIC_DISPATCH(ToLightSpaceExactly) : HWY_DYNAMIC_DISPATCH(ToLightSpace);
  to_light_space(points, mesh_.anchor().data(), u_.data(), v_.data(), d_.data(), lanes);
}

// Returns the reach of occluders, bounded by groups of 8 x 8 quads unless there are more quads than cells (about one
// per sample): then finding these boxes takes longer than they save. (Measured at 15 degrees: over Hadley, ten samples
// per quad, the shadow map takes half the time; over the sample terrain, 0.7 samples per quad, the same.)
ShadowReach ShadowMap::reach_over(const Grid& grid) const {
  std::size_t quads = 0;
  for (const std::uint32_t occluder : order_) {
    const Strip& strip = mesh_.strips()[occluder];
    quads += static_cast<std::size_t>(strip.rows) * static_cast<std::size_t>(mesh_.blocks()[strip.block].quads);
  }
  const bool by_parts = quads <= static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows());
  const int side = by_parts ? 4 : 16;  // side of a reach cell, in cells of the grid
  ShadowReach reach(grid.u0, grid.v0, grid.per_u / static_cast<float>(side), grid.per_v / static_cast<float>(side),
                    grid.columns / side + 1, grid.rows() / side);
  if (by_parts) {
    for (const LightBox& part : occluder_boxes()) reach.add(part);
  } else {
    for (const std::uint32_t occluder : order_) reach.add(occluders_[occluder]);
  }
  for (const LightBox& skirt : skirts_) reach.add(skirt);
  return reach;
}

// Returns the boxes of groups of quads that have triangles facing away from the Sun, in no particular order.
std::vector<LightBox> ShadowMap::occluder_boxes() const {
  return gathered_in_parallel<LightBox>(order_.size(), 16, [&](std::size_t i, std::vector<LightBox>& parts) {
    const Strip& strip = mesh_.strips()[order_[i]];
    LightBox boxes[kMaxOccluderBoxes];
    const std::size_t count = bound_occluders(mesh_.blocks()[strip.block], strip, axes_, boxes);
    for (const LightBox& box : std::span(boxes, count)) parts.push_back(with_rounding_margin(box));
  });
}

// Lists, per band, the groups that touch it and that an occluder may reach, by a counting sort.
void ShadowMap::find_bands(const Grid& grid, const LightSamples& tile, const ShadowReach* reach, BandGroups& out) {
  const auto bands = static_cast<std::size_t>(grid.bands);
  const std::size_t full_groups = tile.count / kPacket;
  const std::size_t groups = (tile.count + kPacket - 1) / kPacket;
  out.bands.resize(groups);
  HWY_DYNAMIC_DISPATCH(BandsOf)(tile.v.data(), full_groups, grid.v0, grid.bands_per_v(), grid.bands, out.bands.data());
  // BandsOf takes only full groups. Assign the incomplete last one to all bands (the first and bands - 1
  // further_bands): CellsOf leaves out samples of other bands.
  if (groups > full_groups) out.bands[full_groups] = static_cast<std::uint32_t>(bands - 1) << 16;
  out.reached.assign(groups, 1);
  if (reach) reach->find_reached(tile.u.data(), tile.v.data(), tile.d.data(), full_groups, out.reached.data());
  out.first.assign(bands + 1, 0);
  const auto for_bands_of = [&](std::size_t g, const auto& visit) {
    if (!out.reached[g]) return;
    const std::uint32_t first_band = out.bands[g] & 0xffff, further_bands = out.bands[g] >> 16;
    for (std::uint32_t b = first_band; b <= first_band + further_bands; ++b) visit(b);
  };
  for (std::size_t g = 0; g < groups; ++g) for_bands_of(g, [&](std::uint32_t b) { ++out.first[b]; });
  std::uint32_t end = 0;
  for (std::uint32_t& count_then_end : out.first) {
    end += count_then_end;
    count_then_end = end;
  }
  out.group.resize(end);
  // Fill each band from its end down, so that out.first ends up at its first group.
  for (std::size_t g = groups; g-- > 0;)
    for_bands_of(g, [&](std::uint32_t b) { out.group[--out.first[b]] = static_cast<std::uint32_t>(g); });
}

// Fills scratch.band and scratch.pixel with all tiles' samples of the band by a counting sort. Returns their number.
std::size_t ShadowMap::sort_by_cell(const Grid& grid, std::size_t band_index, const std::vector<LightSamples>& tiles,
                                    const std::vector<BandGroups>& groups, BandScratch& scratch) const {
  LightBand& band = scratch.band;
  lay_band(grid, band_index, band);
  if (!count_per_cell(grid, band_index, tiles, groups, scratch)) return 0;
  const std::size_t count = sum_cell_counts(band);
  scatter_into_cells(band_index, tiles, groups, count, scratch);
  band.coarse_columns = (grid.columns + LightBand::kCoarse - 1) / LightBand::kCoarse;
  band.min_d.resize(static_cast<std::size_t>(band.coarse_columns) * kBandRows);
  update_coarse_min(band, 0, grid.columns - 1, 0, kBandRows - 1);
  return count;
}

void ShadowMap::lay_band(const Grid& grid, std::size_t band_index, LightBand& band) {
  band.u0 = grid.u0;
  band.v0 = grid.band_start(static_cast<int>(band_index));
  band.per_u = grid.per_u;
  band.per_v = grid.per_v;
  band.columns = grid.columns;
  band.rows = kBandRows;
  // Allow eight units in the last place of the largest coordinate.
  band.margin_m =
      0x1p-20F * std::max({std::abs(band.u0), std::abs(band.u_end()), std::abs(band.v0), std::abs(band.v_end())});
}

// Sets scratch.cell to the cell of each lane of the band's groups, and band.start[c] to the number of samples in cell
// c; lanes of other bands count in one cell past the last. Returns false if no group touches the band.
bool ShadowMap::count_per_cell(const Grid& grid, std::size_t band_index, const std::vector<LightSamples>& tiles,
                               const std::vector<BandGroups>& groups, BandScratch& scratch) {
  LightBand& band = scratch.band;
  std::size_t lanes = 0;
  for (const BandGroups& g : groups) lanes += kPacket * (g.first[band_index + 1] - g.first[band_index]);
  if (lanes == 0) return false;
  scratch.cell.resize(lanes);
  const BandLayout layout{static_cast<std::uint32_t>(band_index), grid.v0, grid.bands_per_v(),
                          static_cast<float>(grid.bands - 1)};
  std::uint32_t* cell = scratch.cell.data();
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    const std::uint32_t first = groups[i].first[band_index], n = groups[i].first[band_index + 1] - first;
    HWY_DYNAMIC_DISPATCH(CellsOf)(tiles[i], groups[i].group.data() + first, n, band, layout, cell);
    cell += std::size_t{n} * kPacket;
  }
  band.start.assign(cells_of(band) + 1, 0);
  std::uint32_t* start = band.start.data();
  for (std::size_t k = 0; k < lanes; ++k) ++start[scratch.cell[k]];
  return true;
}

// Turns the counts in band.start into the end of each cell. Returns the number of samples in all cells.
std::size_t ShadowMap::sum_cell_counts(LightBand& band) {
  const std::size_t cells = cells_of(band);
  std::uint32_t* start = band.start.data();
  std::uint32_t end = 0;
  for (std::size_t c = 0; c < cells; ++c) start[c] = end += start[c];
  start[cells] = end;
  return end;
}

// Copies the samples into their cells. Each cell fills from its end down, so that band.start[c] ends up at its first
// sample.
void ShadowMap::scatter_into_cells(std::size_t band_index, const std::vector<LightSamples>& tiles,
                                   const std::vector<BandGroups>& groups, std::size_t count,
                                   BandScratch& scratch) const {
  LightBand& band = scratch.band;
  const std::size_t cells = cells_of(band);
  std::uint32_t* start = band.start.data();
  scratch.pixel.resize(count);
  band.u.resize(count + kBandPadding);
  band.v.resize(count + kBandPadding);
  band.d.resize(count + kBandPadding);
  for (std::size_t i = count; i < count + kBandPadding; ++i) {
    band.u[i] = band.v[i] = 0;
    band.d[i] = kDark;
  }
  float *u = band.u.data(), *v = band.v.data(), *d = band.d.data();
  std::uint32_t* pixel = scratch.pixel.data();
  if (disc_) scratch.origin.resize(count);
  std::uint32_t* origin = disc_ ? scratch.origin.data() : nullptr;
  const std::uint32_t* cell = scratch.cell.data();
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
        if (origin)
          origin[to] = static_cast<std::uint32_t>(i) << BandScratch::kIndexBits | static_cast<std::uint32_t>(from);
      }
    }
}

// Casts the strips whose box may be above a sample of the band that is not yet dark: marks the samples that they
// shadow.
void ShadowMap::cast_strips(const Grid& grid, int band_index, LightBand& band) const {
  const float lowest = *std::min_element(band.min_d.begin(), band.min_d.end());
  const float u_first = band.u0 - band.margin_m;
  const float u_last = band.u_end() + band.margin_m;
  const float v_first = band.v0 - band.margin_m;
  const float v_last = band.v_end() + band.margin_m;
  for (const std::uint32_t strip_index : order_) {
    const Occluder& occluder = occluders_[strip_index];
    // Skip occluders below every sample; in descending order, all later ones are lower still.
    if (!(occluder.d_high > lowest)) {
      if (descending_) break;
      continue;
    }
    if (occluder.v_high < v_first || occluder.v_low > v_last || occluder.u_high < u_first || occluder.u_low > u_last)
      continue;
    const int c0 = grid.column_of(occluder.u_low);
    const int c1 = grid.column_of(occluder.u_high);
    const int r0 = grid.row_in(band_index, occluder.v_low);
    const int r1 = grid.row_in(band_index, occluder.v_high);
    if (!band.any_below(c0, c1, r0, r1, occluder.d_high)) continue;
    const Strip& strip = mesh_.strips()[strip_index];
    cast_strip(mesh_.blocks()[strip.block], strip, axes_, band);
    // Let later, lower strips be rejected by the samples that are still lit.
    if (descending_) update_coarse_min(band, c0, c1, r0, r1);
  }
}

void ShadowMap::cast_skirts(LightBand& band) const {
  const float u_first = band.u0 - band.margin_m;
  const float u_last = band.u_end() + band.margin_m;
  const float v_first = band.v0 - band.margin_m;
  const float v_last = band.v_end() + band.margin_m;
  for (std::size_t i = 0; i < skirts_.size(); ++i) {
    const LightBox& skirt = skirts_[i];
    if (skirt.v_high < v_first || skirt.v_low > v_last || skirt.u_high < u_first || skirt.u_low > u_last) continue;
    cast_skirt(mesh_.skirts()[i], axes_, band);
  }
}

// Finds the horizons before the disc, and from them the remaining light, of the samples of the band that are not dark.
void ShadowMap::find_horizons(const std::vector<LightSamples>& tiles, BandScratch& scratch, std::size_t count,
                              std::vector<PartlyLit>& out) const {
  LightBand& band = scratch.band;
  struct SampleOrigin {
    const DiscSamples& tile;
    std::size_t at;
  };
  const auto origin_of = [&](std::size_t sample) -> SampleOrigin {
    constexpr std::uint32_t kMask = (1U << BandScratch::kIndexBits) - 1;
    return {tiles[scratch.origin[sample] >> BandScratch::kIndexBits].disc, scratch.origin[sample] & kMask};
  };
  if (!descending_) update_coarse_min(band, 0, band.columns - 1, 0, band.rows - 1);
  scratch.horizons.begin(*disc_, aim_radii_, {u_, v_, d_}, band, count, [&](std::size_t sample) -> LightResidual {
    const auto [tile, at] = origin_of(sample);
    return {tile.rest_u[at], tile.rest_v[at], tile.rest_d[at]};
  });
  for (std::size_t s = 0; s < occluders_.size(); ++s) {
    const Occluder& occluder = occluders_[s];
    if (occluder.horizon) scratch.horizons.add(mesh_, mesh_.strips()[s], occluder);
  }
  constexpr std::size_t kGroup = HorizonGroup::kSize;
  static_assert(kGroup == kPacket);
  alignas(64) float horizons[DiscLight::kColumns][kGroup];
  alignas(64) float share[kGroup];
  alignas(64) float cosine[kGroup];
  DiscLanes disc_lanes{};
  for (std::size_t first = 0; first < count; first += kGroup) {
    if (!scratch.horizons.of_group(first / kGroup, horizons)) continue;
    const std::size_t n = std::min(kGroup, count - first);
    for (std::size_t i = 0; i < kGroup; ++i) {
      const auto [tile, at] = origin_of(first + std::min(i, n - 1));
      tile.get(at, disc_lanes, i);
    }
    disc_->remaining(horizons, disc_lanes, share, cosine);
    for (std::size_t i = 0; i < n; ++i) {
      if (band.d[first + i] == kDark) continue;
      const auto [tile, at] = origin_of(first + i);
      if (!tile.free.empty() && tile.free[at] != DiscSamples::kAllFree) {
        const DiscShare left = disc_->remaining_with_objects(tile.free_of_objects[tile.free[at]], &horizons[0][i],
                                                             kGroup, disc_lanes, static_cast<std::uint32_t>(i));
        share[i] = static_cast<float>(left.share);
        cosine[i] = static_cast<float>(left.cosine);
      }
      if (share[i] < 1 || cosine[i] < 1) out.push_back({scratch.pixel[first + i], share[i], cosine[i]});
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
  // Do not cull by reach for a disc: terrain that hides only part of it reaches farther than the map, which is aimed
  // above it.
  std::optional<ShadowReach> reach;
  if (!disc_) reach = reach_over(grid);
  in_parallel(samples.size(),
              [&](std::size_t i) { find_bands(grid, samples[i], reach ? &*reach : nullptr, scratch.groups[i]); });
  in_parallel(bands, [&](std::size_t b) {
    stop.check();
    const Pool<BandScratch>::Lease band_scratch(scratch.bands);
    const std::size_t count = sort_by_cell(grid, b, samples, scratch.groups, *band_scratch);
    if (count == 0) return;
    cast_strips(grid, static_cast<int>(b), band_scratch->band);
    cast_skirts(band_scratch->band);
    for (std::size_t i = 0; i < count; ++i)
      if (band_scratch->band.d[i] == kDark) scratch.shadowed[b].push_back(band_scratch->pixel[i]);
    if (disc_) find_horizons(samples, *band_scratch, count, scratch.partly[b]);
  });
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
