#include "dem/value_map.h"

#include <fmt/format.h>
#include <gdal_utils.h>
#include <ogr_spatialref.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <mutex>

#include "dem/cache.h"
#include "dem/error.h"
#include "dem/gdal_manners.h"
#include "dem/geodesy.h"

namespace selenograph::dem {
namespace {

constexpr int kTile = 128;  // texels along a tile's side
constexpr std::size_t kTexels = static_cast<std::size_t>(kTile) * kTile;
constexpr std::size_t kCacheBytes = std::size_t{128} << 20;  // per map
constexpr int kMostProbes = 16;                              // along a side
constexpr double kPolar_deg = 75;
constexpr double kRadiusTolerance_m = 1000;  // spheres of the Moon that are in use differ by less
constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

struct TileKey {
  int level, tx, ty;
  bool operator==(const TileKey&) const = default;
};
struct TileKeyHash {
  std::size_t operator()(const TileKey& key) const { return XXH3_64bits(&key, sizeof key); }
};

// Latitude and longitude in degrees on the Moon's sphere, longitude first.
OGRSpatialReference degrees_like(const OGRSpatialReference& srs) {
  OGRSpatialReference degrees;
  degrees.CopyGeogCSFrom(&srs);
  degrees.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return degrees;
}

// From pixel corners to degrees: x grows east by dx, y south by dy.
struct DegreeGrid {
  double west_deg, north_deg, dx_deg, dy_deg;
};

double length_of(const std::array<double, 2>& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1]); }

// Probes along one side of a footprint.
struct Probes {
  int count;
  std::array<double, 2> step, first;
  std::array<double, 2> at(int i) const { return {first[0] + i * step[0], first[1] + i * step[1]}; }
};

// A probe is a mean itself: of a texel's square and of what lies between texels, which together vary by t^2 / 4. So
// that all probes together vary by side^2 / 12 as the side does, they lie a little closer together.
Probes probes_along(const std::array<double, 2>& side, int level) {
  const double texel = std::ldexp(1.0, level), length = length_of(side);
  const double left = length * length - 3 * texel * texel;
  if (left <= 0) return {1, {0, 0}, {0, 0}};
  const int count = std::clamp(static_cast<int>(std::ceil(length / texel)), 2, kMostProbes);
  const double spread = std::sqrt(left / (1 - 1.0 / (count * count))) / length, step = spread / count;
  const double first = 0.5 * (step - spread);
  return {count, {side[0] * step, side[1] * step}, {side[0] * first, side[1] * first}};
}

// A plane that touches the sphere, in texels along a meridian, x east and y south.
class Touching {
 public:
  Touching(double lat_deg, double lon_deg, double texel_m)
      : middle_(to_cartesian({lat_deg, lon_deg, 0})), axes_(local_axes(middle_)), texel_m_(texel_m) {}
  Geographic place(double x, double y) const {
    return to_geographic(middle_ + texel_m_ * (x * axes_.east - y * axes_.north));
  }

 private:
  Vec3 middle_;
  EastNorthUp axes_;
  double texel_m_;
};

// Of level 0, whose first has its middle at (0, 0).
struct Texel {
  double x, y;
};

}  // namespace

struct ValueMap::Impl {
  explicit Impl(const ValueMapOptions& o) : options(o), tiles(kCacheBytes) {
    register_gdal();
    state = file_state(options.path);
    if (!state) throw DataError(options.path, "is missing or not a file");
    const QuietGdal quiet;
    dataset.reset(static_cast<GDALDataset*>(GDALOpenEx(
        options.path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR, nullptr, nullptr, nullptr)));
    if (!dataset) throw DataError(options.path, "can't be opened: " + quiet.complaint());
    lie();
    width = dataset->GetRasterXSize(), height = dataset->GetRasterYSize();
    wraps = std::abs(width * grid.dx_deg - 360) < 0.5 * grid.dx_deg;
    while (std::max(level_width(levels - 1), level_height(levels - 1)) > 1) ++levels;
    choose_bands();
    find_overviews();
  }

  // Where the raster lies.
  void lie() {
    double t[6];
    const bool placed = dataset->GetGeoTransform(t) == CE_None;
    if (options.extent) {
      const Footprint& e = *options.extent;
      const int w = dataset->GetRasterXSize(), h = dataset->GetRasterYSize();
      grid = {e.west_deg, e.north_deg, (e.east_deg - e.west_deg) / w, (e.north_deg - e.south_deg) / h};
      return;
    }
    const OGRSpatialReference* srs = dataset->GetSpatialRef();
    if (!placed || !srs) throw DataError(options.path, "doesn't say where it lies: give its extent");
    if (std::abs(srs->GetSemiMajor() - kMoonRadius_m) > kRadiusTolerance_m)
      throw DataError(options.path, fmt::format("its sphere of {} m is not the Moon's", srs->GetSemiMajor()));
    if (!srs->IsGeographic() || t[1] <= 0 || t[5] >= 0 || t[2] != 0 || t[4] != 0) warp(*srs);
    if (dataset->GetGeoTransform(t) != CE_None) throw DataError(options.path, "has no geotransform");
    grid = {t[0], t[3], t[1], -t[5]};
  }

  void warp(const OGRSpatialReference& srs) {
    char* wkt = nullptr;
    degrees_like(srs).exportToWkt(&wkt);
    // Alpha: what the warped rectangle holds beyond the raster is no value.
    const char* const words[] = {"-of", "VRT", "-t_srs", wkt, "-dstalpha", "-r", "bilinear", nullptr};
    const QuietGdal quiet;
    GDALWarpAppOptions* how = GDALWarpAppOptionsNew(const_cast<char**>(words), nullptr);
    GDALDatasetH source = dataset.get();
    auto* warped = static_cast<GDALDataset*>(GDALWarp("", nullptr, 1, &source, how, nullptr));
    GDALWarpAppOptionsFree(how);
    CPLFree(wkt);
    if (!warped) throw DataError(options.path, "can't be warped to degrees: " + quiet.complaint());
    unwarped = std::move(dataset);
    dataset.reset(warped);
  }

  void choose_bands() {
    if (options.bands.empty())
      for (int b = 1; b <= dataset->GetRasterCount(); ++b)
        if (dataset->GetRasterBand(b)->GetColorInterpretation() != GCI_AlphaBand) options.bands.push_back(b);
    for (const int b : options.bands)
      if (b < 1 || b > dataset->GetRasterCount())
        throw DataError(options.path, fmt::format("has no band {}, only {}", b, dataset->GetRasterCount()));
    if (options.bands.empty()) throw DataError(options.path, "has no band of values");
  }

  // Of each level, the index of the file's overview of that size; -1: none.
  void find_overviews() {
    overviews.assign(static_cast<std::size_t>(levels), -1);
    GDALRasterBand& band = *dataset->GetRasterBand(options.bands[0]);
    for (int i = 0; i < band.GetOverviewCount(); ++i) {
      GDALRasterBand* overview = band.GetOverview(i);
      for (int n = 1; overview && n < levels; ++n)
        if (overview->GetXSize() == level_width(n) && overview->GetYSize() == level_height(n))
          overviews[static_cast<std::size_t>(n)] = i;
    }
  }

  Texel texel_of(double lat_deg, double lon_deg) const {
    const double turned = lon_deg - 360 * std::floor((lon_deg - grid.west_deg) / 360);
    return {(turned - grid.west_deg) / grid.dx_deg - 0.5, (grid.north_deg - lat_deg) / grid.dy_deg - 0.5};
  }

  int level_width(int level) const { return 1 + ((width - 1) >> level); }
  int level_height(int level) const { return 1 + ((height - 1) >> level); }

  std::shared_ptr<const std::vector<float>> tile(const TileKey& key) const {
    return tiles.get(key, [&] {
      auto made = std::make_shared<std::vector<float>>(kTexels, kNone);
      const bool stored = key.level == 0 || overviews[static_cast<std::size_t>(key.level)] >= 0;
      if (stored)
        read(key, *made);
      else
        shrink(key, *made);
      return Cache<TileKey, std::vector<float>, TileKeyHash>::Loaded{std::move(made), kTexels * sizeof(float)};
    });
  }

  void read(const TileKey& key, std::vector<float>& out) const {
    const int x0 = key.tx * kTile, y0 = key.ty * kTile, w = std::min(kTile, level_width(key.level) - x0),
              h = std::min(kTile, level_height(key.level) - y0);
    std::vector<double> samples(kTexels), sum(kTexels, 0);
    std::vector<std::uint8_t> mask(kTexels, 255);
    const std::lock_guard lock(file_mutex);
    if (!current()) throw DataError(options.path, "has changed since it was opened");
    const QuietGdal quiet;
    for (const int b : options.bands) {
      GDALRasterBand* band = dataset->GetRasterBand(b);
      const double scale = band->GetScale(), offset = band->GetOffset();
      if (key.level > 0) band = band->GetOverview(overviews[static_cast<std::size_t>(key.level)]);
      if (!band || band->RasterIO(GF_Read, x0, y0, w, h, samples.data(), w, h, GDT_Float64, 0, kTile * sizeof(double),
                                  nullptr) != CE_None)
        throw DataError(options.path, "can't be read: " + quiet.complaint());
      // NoData, alpha or a mask, whatever the file has.
      if ((band->GetMaskFlags() & GMF_ALL_VALID) == 0 &&
          band->GetMaskBand()->RasterIO(GF_Read, x0, y0, w, h, mask.data(), w, h, GDT_Byte, 0, kTile, nullptr) !=
              CE_None)
        throw DataError(options.path, "its mask can't be read: " + quiet.complaint());
      for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x) {
          const auto at = static_cast<std::size_t>(y * kTile + x);
          const double s = samples[at];
          const bool nothing = mask[at] == 0 || !std::isfinite(s) || (options.no_data && s == *options.no_data);
          sum[at] += nothing ? std::nan("") : s * scale + offset;
        }
    }
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x) {
        const auto at = static_cast<std::size_t>(y * kTile + x);
        const double value = options.scale * (sum[at] / static_cast<double>(options.bands.size())) + options.offset;
        if (!std::isnan(value)) out[at] = static_cast<float>(std::clamp(value, options.low, options.high));
      }
  }

  // Means of 2 x 2 texels of the level below.
  void shrink(const TileKey& key, std::vector<float>& out) const {
    constexpr int kHalf = kTile / 2;
    for (const int dy : {0, 1})
      for (const int dx : {0, 1}) {
        const TileKey below{key.level - 1, 2 * key.tx + dx, 2 * key.ty + dy};
        if (below.tx * kTile >= level_width(below.level) || below.ty * kTile >= level_height(below.level)) continue;
        const auto from = tile(below);
        for (int y = 0; y < kHalf; ++y)
          for (int x = 0; x < kHalf; ++x) {
            float sum = 0, count = 0;
            for (const int k : {0, 1, kTile, kTile + 1}) {
              const float v = (*from)[static_cast<std::size_t>(2 * y * kTile + 2 * x + k)];
              if (!std::isnan(v)) sum += v, ++count;
            }
            if (count > 0) out[static_cast<std::size_t>((dy * kHalf + y) * kTile + dx * kHalf + x)] = sum / count;
          }
      }
  }

  bool current() const {
    const auto now = file_state(options.path);
    return now && now->bytes == state->bytes && now->modified_ns == state->modified_ns;
  }

  ValueMapOptions options;
  std::optional<FileState> state;
  DatasetPtr unwarped, dataset;  // the former outlives the latter
  DegreeGrid grid{};
  int width = 0, height = 0, levels = 1;
  bool wraps = false;
  std::vector<int> overviews;
  mutable std::mutex file_mutex;  // GDAL's datasets are for one thread at a time
  mutable Cache<TileKey, std::vector<float>, TileKeyHash> tiles;
};

ValueMap::ValueMap(const ValueMapOptions& options) : impl_(std::make_unique<Impl>(options)) {}
ValueMap::~ValueMap() = default;
ValueMap::ValueMap(ValueMap&&) noexcept = default;

bool ValueMap::current() const { return impl_->current(); }

std::uint64_t ValueMap::fingerprint() const {
  const ValueMapOptions& o = impl_->options;
  std::string identity =
      fmt::format("{}:{}:{}:{:a}:{:a}:{:a}:{:a}:{}", o.path, impl_->state->bytes, impl_->state->modified_ns, o.scale,
                  o.offset, o.low, o.high, fmt::join(o.bands, ","));
  if (o.no_data) identity += fmt::format(":{:a}", *o.no_data);
  if (o.extent)
    identity += fmt::format(":{:a}:{:a}:{:a}:{:a}", o.extent->west_deg, o.extent->east_deg, o.extent->south_deg,
                            o.extent->north_deg);
  return XXH3_64bits(identity.data(), identity.size());
}

const std::vector<float>& ValueMap::Sampler::tile(int tx, int ty, int level) {
  Held& held = held_[static_cast<std::size_t>((tx & 1) | (ty & 1) << 1 | (level & 3) << 2)];
  if (held.level != level || held.tx != tx || held.ty != ty) held = {level, tx, ty, map_->impl_->tile({level, tx, ty})};
  return *held.tile;
}

float ValueMap::Sampler::texel(int x, int y, int level) {
  const Impl& map = *map_->impl_;
  const int w = map.level_width(level);
  if (map.wraps) x = (x % w + w) % w;
  if (x < 0 || x >= w) return kNone;
  // Above a map's first row there is nothing; but above the pole's there is the pole's.
  const int h = map.level_height(level);
  if (y == -1 && map.grid.north_deg > 90 - 1e-9) y = 0;
  if (y == h && map.grid.north_deg - map.height * map.grid.dy_deg < -90 + 1e-9) y = h - 1;
  if (y < 0 || y >= h) return kNone;
  return tile(x / kTile, y / kTile, level)[static_cast<std::size_t>((y % kTile) * kTile + x % kTile)];
}

// x, y: in texels of level 0.
ValueMap::Sampler::Sum ValueMap::Sampler::bilinear(double x, double y, int level) {
  const double shrink = std::ldexp(1.0, -level), xn = (x + 0.5) * shrink - 0.5, yn = (y + 0.5) * shrink - 0.5;
  const double x0 = std::floor(xn), y0 = std::floor(yn), fx = xn - x0, fy = yn - y0;
  // Mostly all four are in one tile, and have values.
  const int left = static_cast<int>(x0), top = static_cast<int>(y0), in_x = left % kTile, in_y = top % kTile;
  const Impl& map = *map_->impl_;
  if (left >= 0 && top >= 0 && in_x < kTile - 1 && in_y < kTile - 1 && left + 1 < map.level_width(level) &&
      top + 1 < map.level_height(level)) {
    const float* t = tile(left / kTile, top / kTile, level).data() + in_y * kTile + in_x;
    const double upper = (1 - fx) * static_cast<double>(t[0]) + fx * static_cast<double>(t[1]),
                 lower = (1 - fx) * static_cast<double>(t[kTile]) + fx * static_cast<double>(t[kTile + 1]),
                 value = (1 - fy) * upper + fy * lower;
    if (!std::isnan(value)) return {value, 1};
  }
  Sum sum{0, 0};
  for (const int dy : {0, 1})
    for (const int dx : {0, 1}) {
      const double weight = (dx ? fx : 1 - fx) * (dy ? fy : 1 - fy);
      if (weight == 0) continue;
      const float v = texel(static_cast<int>(x0) + dx, static_cast<int>(y0) + dy, level);
      if (!std::isnan(v)) sum.value += weight * static_cast<double>(v), sum.weight += weight;
    }
  return sum;
}

double ValueMap::Sampler::mean(const Footprint2& f) {
  const Impl& map = *map_->impl_;
  const DegreeGrid& g = map.grid;
  const bool polar = std::abs(f.lat_deg) > kPolar_deg;
  // Sides in texels. Near a pole a row's texels are many for little ground: there, texels along a meridian count, and
  // probes lie on the plane that touches the sphere.
  const double texel_m = g.dy_deg * kMetresPerDegree;
  const double across =
      polar ? 1 / texel_m : 1 / (g.dx_deg * kMetresPerDegree * std::cos(f.lat_deg * kRadiansPerDegree));
  const std::array<double, 2> a{f.a_m[0] * across, -f.a_m[1] / texel_m}, b{f.b_m[0] * across, -f.b_m[1] / texel_m};
  const double a_length = length_of(a), b_length = length_of(b);
  // Texels of half the shorter side at most, as far as the longer one allows: a probe is made of few texels, and many
  // probes make the footprint.
  const double size = std::max({std::min(a_length, b_length), std::max(a_length, b_length) / (0.5 * kMostProbes), 2.0});
  const int level = size < 4 ? 0 : std::min(static_cast<int>(std::log2(size / 2)), map.levels - 1);
  const Probes along_a = probes_along(a, level), along_b = probes_along(b, level);
  const Texel middle = map.texel_of(f.lat_deg, f.lon_deg);
  if (along_a.count == 1 && along_b.count == 1) {
    const Sum one = bilinear(middle.x, middle.y, level);
    return one.weight >= 0.5 ? one.value / one.weight : std::nan("");
  }
  std::optional<Touching> plane;
  if (polar) plane.emplace(f.lat_deg, f.lon_deg, texel_m);
  Sum sum{0, 0};
  for (int j = 0; j < along_b.count; ++j)
    for (int i = 0; i < along_a.count; ++i) {
      const auto [ax, ay] = along_a.at(i);
      const auto [bx, by] = along_b.at(j);
      Texel probe{middle.x + ax + bx, middle.y + ay + by};
      if (polar) {
        const Geographic place = plane->place(ax + bx, ay + by);
        probe = map.texel_of(place.lat_deg, place.lon_deg);
      }
      const Sum one = bilinear(probe.x, probe.y, level);
      sum.value += one.value, sum.weight += one.weight;
    }
  // A place has a value where at least half of what it is made from has.
  return sum.weight >= 0.5 * along_a.count * along_b.count ? sum.value / sum.weight : std::nan("");
}

}  // namespace selenograph::dem
