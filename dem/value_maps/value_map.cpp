#include "dem/value_maps/value_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <mutex>

#include "dem/base/cache.h"
#include "dem/base/hash.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {
namespace {

constexpr int kTile = kMapTile;  // texels along a side of a tile
constexpr std::size_t kTexels = static_cast<std::size_t>(kTile) * kTile;
constexpr int kMaxProbes = 16;     // along a side
constexpr double kPolar_deg = 75;  // latitude from which a texel is about a quarter as wide as high, or less
constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

// Level 0 has the raster's own texels, each further level half as many along a side; tx and ty count tiles.
struct TileKey {
  std::uint64_t map;
  std::int64_t level, tx, ty;
  bool operator==(const TileKey&) const = default;
};
struct TileKeyHash {
  std::size_t operator()(const TileKey& key) const { return hash_of(&key, sizeof key); }
};

// Values of the texels, then their shares that have data, unless each valid texel is complete.
using TileValues = std::shared_ptr<const std::vector<float>>;

double fourth_root(double value) { return std::sqrt(std::sqrt(value)); }

double length_of(const std::array<double, 2>& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1]); }

// Probes along one side of a footprint: offsets from its middle, in texels of level 0.
struct Probes {
  int count;
  std::array<double, 2> step, first;
  std::array<double, 2> at(int i) const { return {first[0] + i * step[0], first[1] + i * step[1]}; }
};

// Places the probes along a side. Averaging over probes must blur the map by the variance of the side, side^2 / 12. A
// probe of a level with texels of size t has a variance of t^2 / 4 itself (the texel's square and the interpolation),
// against 1 / 4 of a point of level 0. So the probes of coarse levels lie a little closer together.
Probes probes_along(const std::array<double, 2>& side, int level) {
  constexpr double kPoint = 0.05;  // sides shorter than this share of a texel have one probe
  const double texel = std::ldexp(1.0, level), length = length_of(side);
  // Squared side whose variance is what the texels' own leave to the spread of the probes.
  const double squared_spread = length * length - 3 * (texel * texel - 1);
  if (length < kPoint || squared_spread <= 0) return {1, {0, 0}, {0, 0}};
  const int count = std::clamp(static_cast<int>(std::ceil(length / texel)) + (level == 0), 2, kMaxProbes);
  const double spread = std::sqrt(squared_spread / (1 - 1.0 / (count * count))) / length, step = spread / count;
  const double first = 0.5 * (step - spread);
  return {count, {side[0] * step, side[1] * step}, {side[0] * first, side[1] * first}};
}

// A plane tangential to the sphere, with x east and y south in units of a texel's height.
class TangentPlane {
 public:
  TangentPlane(double lat_deg, double lon_deg, double texel_m)
      : middle_(to_cartesian({lat_deg, lon_deg, 0})), axes_(local_axes(lat_deg, lon_deg)), texel_m_(texel_m) {}
  Geographic position(double x, double y) const {
    return to_geographic(middle_ + texel_m_ * (x * axes_.east - y * axes_.north));
  }

 private:
  Vec3 middle_;
  EastNorthUp axes_;
  double texel_m_;
};

// Returns the share of a texel that has data, 0 to 1. A tile holds kTexels values, followed by their shares unless
// every valid texel is complete.
double coverage_of(const std::vector<float>& tile, std::size_t texel) {
  if (std::isnan(tile[texel])) return 0;
  return tile.size() > kTexels ? static_cast<double>(tile[kTexels + texel]) : 1;
}

// Position in texels of level 0, whose first texel is centred at (0, 0).
struct Texel {
  double x, y;
};

}  // namespace

class ValueMapTiles {
 public:
  explicit ValueMapTiles(std::size_t bytes) : tiles(bytes) {}
  Cache<TileKey, std::vector<float>, TileKeyHash> tiles;
  std::atomic<std::uint64_t> maps{0};  // number of maps opened so far
};

std::shared_ptr<ValueMapTiles> make_value_map_tiles(std::size_t bytes) {
  return std::make_shared<ValueMapTiles>(bytes);
}

struct ValueMap::Impl {
  Impl(const ValueMapOptions& o, std::shared_ptr<ValueMapTiles> t)
      : options(o), file(o), tiles(std::move(t)), number(tiles->maps++) {
    width = file.width();
    height = file.height();
    texels_per_deg = {1 / file.grid().dx_deg, 1 / file.grid().dy_deg};
    wraps = std::abs(width * file.grid().dx_deg - 360) < 0.5 * file.grid().dx_deg;
    while (std::max(level_width(levels - 1), level_height(levels - 1)) > 1) ++levels;
    // Use overviews, which hold means of samples, unless fourth powers are averaged. For other exponents the power of a
    // mean differs from the mean of powers in second order only: by 0.6 % for an exponent of 2.8 and samples that vary
    // by 5 % within a texel. Temperatures vary by more.
    for (int n = 1; n < levels; ++n)
      overviews.push_back(o.fourth_power ? -1 : file.overview_of_size(level_width(n), level_height(n)));
  }

  // Returns the position in texels of level 0, on the turn around the globe that begins at the raster's western border.
  Texel texel_of(double lat_deg, double lon_deg) const {
    const double east_deg = lon_deg - file.grid().west_deg;
    return {(east_deg - 360 * std::floor(east_deg / 360)) * texels_per_deg[0] - 0.5,
            (file.grid().north_deg - lat_deg) * texels_per_deg[1] - 0.5};
  }

  // Converts a side from metres to texels.
  std::array<double, 2> side_of(const std::array<double, 2>& side_m, double cos_lat) const {
    constexpr double kDegreesPerMetre = 1 / kMetresPerDegree;
    return {side_m[0] * (texels_per_deg[0] * kDegreesPerMetre) / cos_lat,
            -side_m[1] * (texels_per_deg[1] * kDegreesPerMetre)};
  }

  int level_width(int level) const { return 1 + ((width - 1) >> level); }
  int level_height(int level) const { return 1 + ((height - 1) >> level); }

  // Returns a tile. A tile of a coarse level without an overview reads all of the file that it covers, once.
  TileValues tile(int level, int tx, int ty, const StopToken& stop) const {
    const auto make = [&] {
      stop.check();
      auto tile = std::make_shared<std::vector<float>>(kTexels, kNone);
      const bool stored = level == 0 || overviews[static_cast<std::size_t>(level)] >= 0;
      if (stored)
        read(level, tx, ty, *tile);
      else
        shrink(level, tx, ty, *tile, stop);
      const std::size_t bytes = tile->size() * sizeof(float);
      return Cache<TileKey, std::vector<float>, TileKeyHash>::Loaded{std::move(tile), bytes};
    };
    return tiles->tiles.get({number, level, tx, ty}, make, stop);
  }

  // Reads a tile from the file or its overview, and converts samples to values. Texels without data keep kNone.
  void read(int level, int tx, int ty, std::vector<float>& out) const {
    const int x0 = tx * kTile, y0 = ty * kTile, w = std::min(kTile, level_width(level) - x0),
              h = std::min(kTile, level_height(level) - y0);
    std::vector<double> samples(kTexels);
    file.read(overviews[static_cast<std::size_t>(level)], {x0, y0, w, h}, kTile, samples.data());
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x) {
        const auto texel = static_cast<std::size_t>(y * kTile + x);
        double value = options.scale * samples[texel] + options.offset;
        if (options.exponent != 1) value = std::pow(value, options.exponent);
        if (std::isnan(value)) continue;
        value = std::clamp(value, options.low, options.high);
        out[texel] = static_cast<float>(options.fourth_power ? std::pow(std::max(value, 0.0), 4) : value);
      }
  }

  // Averages 2 x 2 texels of the level below, weighted by the share of each that has data. Texels beyond the raster's
  // last row and column do not count. Shares follow the values in `out`, unless all are 0 or 1.
  void shrink(int level, int tx, int ty, std::vector<float>& out, const StopToken& stop) const {
    constexpr int kHalf = kTile / 2;
    out.resize(2 * kTexels, 0.F);
    bool complete = true;  // every valid texel has a share of 1
    for (const int dy : {0, 1})
      for (const int dx : {0, 1}) {
        const int x = 2 * tx + dx, y = 2 * ty + dy;
        const int w = level_width(level - 1) - x * kTile, h = level_height(level - 1) - y * kTile;
        if (w <= 0 || h <= 0) continue;
        const TileValues finer = tile(level - 1, x, y, stop);
        for (int v = 0; 2 * v < std::min(kTile, h); ++v)
          for (int u = 0; 2 * u < std::min(kTile, w); ++u) {
            double sum = 0, covered = 0;
            int count = 0;
            for (const int j : {2 * v, 2 * v + 1})
              for (const int i : {2 * u, 2 * u + 1}) {
                if (i >= w || j >= h) continue;
                const auto texel = static_cast<std::size_t>(j * kTile + i);
                const double coverage = coverage_of(*finer, texel);
                ++count;
                covered += coverage;
                if (coverage > 0) sum += coverage * static_cast<double>((*finer)[texel]);
              }
            const auto to = static_cast<std::size_t>((dy * kHalf + v) * kTile + dx * kHalf + u);
            if (covered > 0) out[to] = static_cast<float>(sum / covered);
            out[kTexels + to] = static_cast<float>(covered / count);
            complete &= covered == 0 || covered == count;
          }
      }
    if (!complete) return;
    out.resize(kTexels);
    out.shrink_to_fit();
  }

  ValueMapOptions options;
  ValueRaster file;
  int width = 0, height = 0, levels = 1;
  std::array<double, 2> texels_per_deg{};
  bool wraps = false;
  std::vector<int> overviews{-1};  // by level, the file's overview of that size; -1: none
  std::shared_ptr<ValueMapTiles> tiles;
  std::uint64_t number;  // this map's number in the keys of tiles
  std::once_flag once_flag;
  std::optional<double> once;  // result of ValueMap::once
};

double ValueMap::Footprint2::cosine(double lat_deg) { return std::cos(lat_deg * kRadiansPerDegree); }

ValueMap::ValueMap(const ValueMapOptions& options, std::shared_ptr<ValueMapTiles> tiles)
    : impl_(std::make_unique<Impl>(options, std::move(tiles))) {}
ValueMap::~ValueMap() = default;
ValueMap::ValueMap(ValueMap&&) noexcept = default;

const std::string& ValueMap::path() const { return impl_->options.path; }

bool ValueMap::current() const { return impl_->file.current(); }

const std::optional<RadianceFactor>& ValueMap::radiance_factor() const { return impl_->options.radiance_factor; }

std::optional<double> ValueMap::once(const std::function<std::optional<double>()>& number) const {
  std::call_once(impl_->once_flag, [&] { impl_->once = number(); });
  return impl_->once;
}

// Hashes the file's state and all options that change a value.
std::uint64_t ValueMap::fingerprint() const {
  const ValueMapOptions& o = impl_->options;
  // Hash the bits of numbers, not their text, which differs between versions of libraries.
  StreamedHash hash;
  hash.add_text(o.path);
  // Hash the count first, so that an absent option differs from any other.
  const auto add_numbers = [&](const std::vector<double>& values) {
    hash.add(values.size());
    for (const double value : values) hash.add(value);
  };
  hash.add(stamp_of(impl_->file.state()));
  hash.add(impl_->file.bands().size());
  for (const int band : impl_->file.bands()) hash.add(band);
  add_numbers({o.scale, o.offset, o.low, o.high, o.exponent, o.fourth_power ? 4.0 : 1.0});
  const auto& r = o.radiance_factor;
  const auto& e = o.extent;
  add_numbers(r ? std::vector{r->incidence_deg, r->emission_deg, r->phase_deg, r->wavelength_um}
                : std::vector<double>());
  add_numbers(o.no_data ? std::vector{*o.no_data} : std::vector<double>());
  add_numbers(e ? std::vector{e->west_deg, e->east_deg, e->south_deg, e->north_deg} : std::vector<double>());
  return hash.digest();
}

const std::vector<float>& ValueMap::Sampler::tile(int tx, int ty, int level) {
  CachedTile& entry = cached_tiles_[static_cast<std::size_t>((tx & 1) | (ty & 1) << 1 | (level & 3) << 2)];
  if (entry.level != level || entry.tx != tx || entry.ty != ty)
    entry = {level, tx, ty, map_->impl_->tile(level, tx, ty, *stop_)};
  return *entry.tile;
}

// Returns a texel's value times the share of it that has data, and that share. x, y: column and row in the level; may
// lie outside the map.
ValueMap::Sampler::Sum ValueMap::Sampler::texel(int x, int y, int level) {
  const Impl& map = *map_->impl_;
  const int w = map.level_width(level);
  if (map.wraps) x = (x % w + w) % w;
  if (x < 0 || x >= w) return {0, 0};
  // Repeat the row at a pole beyond the pole. Beyond other borders there is no data.
  const int h = map.level_height(level);
  if (y == -1 && map.file.grid().north_deg > 90 - 1e-9) y = 0;
  if (y == h && map.file.grid().north_deg - map.height * map.file.grid().dy_deg < -90 + 1e-9) y = h - 1;
  if (y < 0 || y >= h) return {0, 0};
  const std::vector<float>& texels = tile(x / kTile, y / kTile, level);
  const auto index = static_cast<std::size_t>((y % kTile) * kTile + x % kTile);
  const double coverage = coverage_of(texels, index);
  return {coverage > 0 ? coverage * static_cast<double>(texels[index]) : 0, coverage};
}

// Returns the bilinear value of a level at x, y in texels of level 0, weighted by the share that has data.
ValueMap::Sampler::Sum ValueMap::Sampler::bilinear(double x, double y, int level) {
  const double shrink = std::ldexp(1.0, -level), xn = (x + 0.5) * shrink - 0.5, yn = (y + 0.5) * shrink - 0.5;
  const double x0 = std::floor(xn), y0 = std::floor(yn), fx = xn - x0, fy = yn - y0;
  // Take the fast path for the usual case: all four texels are valid and in one tile.
  const int left = static_cast<int>(x0), top = static_cast<int>(y0), in_x = left % kTile, in_y = top % kTile;
  const Impl& map = *map_->impl_;
  if (left >= 0 && top >= 0 && in_x < kTile - 1 && in_y < kTile - 1 && left + 1 < map.level_width(level) &&
      top + 1 < map.level_height(level)) {
    const std::vector<float>& texels = tile(left / kTile, top / kTile, level);
    const float* t = texels.data() + in_y * kTile + in_x;
    const double upper = (1 - fx) * static_cast<double>(t[0]) + fx * static_cast<double>(t[1]),
                 lower = (1 - fx) * static_cast<double>(t[kTile]) + fx * static_cast<double>(t[kTile + 1]),
                 value = (1 - fy) * upper + fy * lower;
    if (!std::isnan(value) && texels.size() == kTexels) return {value, 1};
  }
  Sum sum{0, 0};
  for (const int dy : {0, 1})
    for (const int dx : {0, 1}) {
      const double weight = (dx ? fx : 1 - fx) * (dy ? fy : 1 - fy);
      if (weight == 0) continue;
      const Sum corner = texel(static_cast<int>(x0) + dx, static_cast<int>(y0) + dy, level);
      sum.value += weight * corner.value;
      sum.weight += weight * corner.weight;
    }
  return sum;
}

std::uint32_t ValueMap::Sampler::means_of_small(const Footprints& footprints, std::uint32_t requested, double* values) {
  const std::uint32_t found = means_in_tile(footprints, requested, values);
  for (std::uint32_t bits = map_->impl_->options.fourth_power ? found : 0; bits != 0; bits &= bits - 1) {
    double& value = values[std::countr_zero(bits)];
    value = fourth_root(value);
  }
  return found;
}

// Samples footprints in the full-resolution tile of the first requested one, then those that cross its border.
std::uint32_t ValueMap::Sampler::means_in_tile(const Footprints& footprints, std::uint32_t requested, double* values) {
  const Impl& map = *map_->impl_;
  const auto first = static_cast<std::size_t>(std::countr_zero(requested));
  const Texel middle = map.texel_of(footprints.lat_deg[first], footprints.lon_deg[first]);
  if (!(middle.x >= 0 && middle.y >= 0 && middle.x < map.width && middle.y < map.height)) return 0;
  const int tx = static_cast<int>(middle.x) / kTile, ty = static_cast<int>(middle.y) / kTile;
  const std::vector<float>& texels = tile(tx, ty, 0);
  const int columns = std::min(kTile, map.width - tx * kTile), rows = std::min(kTile, map.height - ty * kTile);
  if (texels.size() != kTexels || columns < 2 || rows < 2) return 0;
  const auto [per_deg_east, per_deg_south] = map.texels_per_deg;
  const std::uint32_t found = small_means(
      {texels.data(), footprints.lon_deg[first] - (middle.x - tx * kTile) / per_deg_east,
       footprints.lat_deg[first] + (middle.y - ty * kTile) / per_deg_south, per_deg_east, per_deg_south, columns, rows},
      footprints, requested, values);
  const std::uint32_t left = requested & ~found;
  return left != 0 ? found | means_between_tiles(footprints, left, values) : found;
}

// Gathers 8 x 8 texels around the first requested footprint, across tile borders, and samples them like a tile.
// Sampling each footprint by itself would look up sixteen texels for each.
std::uint32_t ValueMap::Sampler::means_between_tiles(const Footprints& f, std::uint32_t requested, double* values) {
  constexpr int kSide = 8;
  const Impl& map = *map_->impl_;
  const auto first = static_cast<std::size_t>(std::countr_zero(requested));
  const std::array<double, 2> a = map.side_of({f.a_east_m[first], f.a_north_m[first]}, f.cos_lat[first]),
                              b = map.side_of({f.b_east_m[first], f.b_north_m[first]}, f.cos_lat[first]);
  if (!(length_of(a) <= 1 && length_of(b) <= 1)) return 0;
  const Texel middle = map.texel_of(f.lat_deg[first], f.lon_deg[first]);
  const int x0 = static_cast<int>(std::floor(middle.x)) - kSide / 2 + 1,
            y0 = static_cast<int>(std::floor(middle.y)) - kSide / 2 + 1;
  std::array<float, static_cast<std::size_t>(kSide) * kTile> texels;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const Sum value = texel(x0 + x, y0 + y, 0);
      texels[static_cast<std::size_t>(y * kTile + x)] = value.weight == 1 ? static_cast<float>(value.value) : kNone;
    }
  const auto [per_deg_east, per_deg_south] = map.texels_per_deg;
  alignas(64) double means[kFootprints];
  const std::uint32_t found = requested & small_means({texels.data(), f.lon_deg[first] - (middle.x - x0) / per_deg_east,
                                                       f.lat_deg[first] + (middle.y - y0) / per_deg_south, per_deg_east,
                                                       per_deg_south, kSide, kSide},
                                                      f, requested, means);
  for (std::uint32_t bits = found; bits != 0; bits &= bits - 1) {
    const auto i = static_cast<std::size_t>(std::countr_zero(bits));
    values[i] = means[i];
  }
  return found;
}

// Averages bilinear probes, spread over the footprint's parallelogram, on the level that suits its size.
ValueMap::Sampler::Mean ValueMap::Sampler::mean(const Footprint2& f) {
  const Impl& map = *map_->impl_;
  const bool polar = std::abs(f.lat_deg) > kPolar_deg;
  // Convert the sides to texels. Near a pole, where texels are narrow, count in texels' heights, and put the probes on
  // the plane tangential to the sphere.
  const double texel_m = map.file.grid().dy_deg * kMetresPerDegree;
  const auto side = [&](const std::array<double, 2>& m) {
    return polar ? std::array{m[0] / texel_m, -m[1] / texel_m} : map.side_of(m, f.cos_lat);
  };
  const std::array<double, 2> a = side(f.a_m), b = side(f.b_m);
  const double a_length = length_of(a), b_length = length_of(b);
  // Choose the level whose texels are at most half the shorter side, so that many probes of few texels each cover the
  // footprint. A long side may need coarser texels, because it has at most kMaxProbes.
  const double size = std::max({std::min(a_length, b_length), std::max(a_length, b_length) / (0.5 * kMaxProbes), 2.0});
  const int level = size < 4 ? 0 : std::min(static_cast<int>(std::log2(size / 2)), map.levels - 1);
  const Texel middle = map.texel_of(f.lat_deg, f.lon_deg);
  std::optional<TangentPlane> plane;
  if (polar) plane.emplace(f.lat_deg, f.lon_deg, texel_m);
  const auto mean_of_level = [&](int probed_level) -> Mean {
    const Probes along_a = probes_along(a, probed_level), along_b = probes_along(b, probed_level);
    Sum sum{0, 0};
    for (int j = 0; j < along_b.count; ++j)
      for (int i = 0; i < along_a.count; ++i) {
        const auto [ax, ay] = along_a.at(i);
        const auto [bx, by] = along_b.at(j);
        Texel probe{middle.x + ax + bx, middle.y + ay + by};
        if (polar) {
          const Geographic position = plane->position(ax + bx, ay + by);
          probe = map.texel_of(position.lat_deg, position.lon_deg);
        }
        const Sum probed = bilinear(probe.x, probe.y, probed_level);
        sum.value += probed.value;
        sum.weight += probed.weight;
      }
    const double mean = sum.weight > 0 ? sum.value / sum.weight : std::nan("");
    return {map.options.fourth_power ? fourth_root(mean) : mean, sum.weight / (along_a.count * along_b.count)};
  };
  const Mean mean = mean_of_level(level);
  // Repeat with more, smaller probes at the border of the data, where few probes would weight the valid area unevenly.
  return mean.coverage > 0 && mean.coverage < 1 - 1e-9 && level > 0 ? mean_of_level(std::max(0, level - 2)) : mean;
}

}  // namespace selenograph::dem
