#include "engine/indirect/light_tile.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numbers>
#include <optional>

#include "dem/base/once.h"
#include "dem/base/parallel.h"
#include "dem/grid/lattice.h"
#include "engine/radiometry/earth.h"
#include "engine/radiometry/mapped_surface.h"
#include "engine/relief/terrain_heights.h"
#include "engine/support/stopwatch.h"

namespace selenograph::engine {
namespace {

// Returns the ground's albedo by the request's maps; empty without maps.
GroundAlbedo albedo_of(const FrameRequest& request) {
  if (request.albedo_maps.empty()) return {};
  return [albedo_maps = AlbedoMaps(request)](double size_m, std::span<const Vec3> directions, std::span<float> albedo,
                                             const StopToken& stop) {
    std::vector<ScaledMap> maps = albedo_maps.sampled(stop);
    for (std::size_t i = 0; i < directions.size(); ++i) {
      const Geographic position = to_geographic(directions[i]);
      double sum = 0;
      visit_coverage(
          maps, {position.lat_deg, position.lon_deg, {size_m, 0}, {0, size_m}}, albedo_maps.fallback(),
          [&](double value, double share) { sum += share * std::clamp(value, 0.0, albedo_maps.max_value()); });
      albedo[i] = static_cast<float>(sum);  // mean over the maps and the fallback that cover the square
    }
  };
}

// Returns the source for a Sun of 1 W m-2: cached light serves every irradiance of the Sun.
SlopeLightSource source_of(const FrameRequest& request) {
  Reflectance reflectance = request.reflectance;
  const bool mapped = !request.albedo_maps.empty();
  if (mapped) reflectance.rho = 1;  // the map's values replace it
  return {.sun = request.sun,
          .irradiance_w_m2 = 1,
          .brdf = Brdf(reflectance, band_of(request)),
          .albedo_is_w = mapped && reflectance.model == ReflectanceModel::hapke,
          .albedo = albedo_of(request),
          .bounces = request.indirect.bounces};
}

// Returns a hash of everything except the position that light depends on.
ContentKey key_of(const TileInputs& inputs) {
  const FrameRequest& request = inputs.request;
  ContentHash hash;
  hash.add(inputs.terrain.detail_number());
  hash.add(request.indirect.terrain);
  if (request.indirect.terrain) {
    const Reflectance& r = request.reflectance;
    const HapkeParameters& h = r.hapke;
    hash.add(request.sun.direction);
    hash.add(request.indirect.bounces);
    for (const double value : {request.sun.angular_radius_deg, r.lommel_seeliger_weight, r.rho, r.shininess,
                               r.limb_darkening.value_or(-1), h.w, h.b0, h.h, h.b, h.c, h.theta_bar_deg, h.bc0, h.hc})
      hash.add(value);
    hash.add(r.model);
    hash.add(r.phase);
    hash.add(r.ground);
    hash.add(h.phase_function);
    hash.add(h.terms);
    if (r.model == ReflectanceModel::moon && request.band)  // only this model's reflectance depends on the band
      for (const ResponsePoint& p : request.band->response()) {
        hash.add(p.wavelength_um);
        hash.add(p.response);
      }
    for (const auto& map : request.albedo_maps) hash.add(map->fingerprint());
  }
  if (request.indirect.earth) {
    hash.add(request.indirect.earth->direction);
    hash.add(request.indirect.earth->distance_m);
  }
  return hash.key();
}

void add_to_hash(const LightField& field, ContentHash& hash) {
  hash.add(field.level);
  hash.add(field.finest);
  hash.add(field.closer);
  hash.add(field.band);
  hash.add(field.cell);
}

// Returns the key of a tile, or with tile -1 of the field's patch.
ContentKey key_of(const ContentKey& light, const LightField& field, int tile) {
  ContentHash hash;
  hash.add(light.low);
  hash.add(light.high);
  add_to_hash(field, hash);
  hash.add(tile);
  return hash.key();
}

// Returns the key of a field's relief, which depends on no light.
ContentKey key_of(const dem::Terrain& terrain, const LightField& field) {
  ContentHash hash;
  hash.add(terrain.detail_number());
  add_to_hash(field, hash);
  return hash.key();
}

// Copies the vectors of the sectors to an empty post, with their sums, which interpolation needs for each pixel.
void set_light(const SectorLight& sectors, LightPost& post) {
  for (std::size_t k = 0; k < kSectors; ++k) {
    const Vec3f& light = sectors.from[k];
    post.x[k] = light.x();
    post.y[k] = light.y();
    post.z[k] = light.z();
    post.sum.x += light.x();
    post.sum.y += light.y();
    post.sum.z += light.z();
    post.sum.fluence += light.norm();
  }
}

// Size of a row's view along 64 azimuths on rough ground; along 32 it is half of this.
constexpr std::size_t kMeanViewBytes = 100000;

// Adds parts of the elapsed time of all rows: those of the threads' time, rows_ms. The rest is that of gathering.
void add_shares(const LightWork& work, double rows_ms, double elapsed_ms, LightTimes& times) {
  const double scale = rows_ms > 0 ? elapsed_ms / rows_ms : 0;
  times.views_ms += scale * work.views_ms;
  times.sunlit_ms += scale * work.sunlit_ms;
  times.bounces_ms += scale * work.bounces_ms;
  times.gather_ms += scale * std::max(rows_ms - work.views_ms - work.sunlit_ms - work.bounces_ms, 0.0);
}

// Returns the step of the lattice of directions, for a source above a position whose vertical is `up`: 0.02 degrees,
// doubled up to four times while it is at most 1/150 of the source's elevation.
double lattice_step_deg(const Vec3& direction, const Vec3& up) {
  constexpr double kFinest_deg = 0.02, kShareOfElevation = 1.0 / 150;
  constexpr int kMaxDoublings = 4;
  const double elevation_deg = std::asin(std::clamp(direction.dot(up), -1.0, 1.0)) * kDegreesPerRadian;
  double step_deg = kFinest_deg;
  for (int k = 0; k < kMaxDoublings && 2 * step_deg <= kShareOfElevation * elevation_deg; ++k) step_deg *= 2;
  return step_deg;
}

// Rounds a direction to the lattice of latitude and longitude. `up`: vertical of the field's middle.
Vec3 on_lattice(const Vec3& direction, const Vec3& up) {
  const double step = lattice_step_deg(direction, up) * kRadiansPerDegree;
  const auto rounded = [&](double angle) { return std::round(angle / step) * step; };
  const double lat = rounded(std::atan2(direction.z(), std::hypot(direction.x(), direction.y()))),
               lon = rounded(std::atan2(direction.y(), direction.x()));
  return {std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat)};
}

// Rounds Sun and Earth of a request, so that frames of a moving Sun share cached light.
FrameRequest on_lattice(FrameRequest request, const Vec3& up) {
  constexpr double kRadiusStep_deg = 1e-3, kDistanceStep_m = 1e6;
  Sun& sun = request.sun;
  sun.direction = on_lattice(sun.direction, up);
  sun.angular_radius_deg = std::round(sun.angular_radius_deg / kRadiusStep_deg) * kRadiusStep_deg;
  if (auto& earth = request.indirect.earth)
    *earth = {on_lattice(earth->direction, up), std::round(earth->distance_m / kDistanceStep_m) * kDistanceStep_m};
  return request;
}

}  // namespace

LightSources light_sources(const FrameRequest& request, double direct_w_m2) {
  LightSources sources{.sun_w_m2 = direct_w_m2};
  if (const auto& earth = request.indirect.earth) {
    sources.earth_w_m2 = direct_w_m2 * earth_over_sun(*earth, request.sun, band_of(request));
    sources.earth = earth->direction;
    sources.earth_radius = earth_radius_deg(earth->distance_m) * kRadiansPerDegree;
  }
  return sources;
}

// A cached tile. Each row is made once, by the first thread that needs it, so a constant object changes.
class LightTiles::CachedTile {
 public:
  const LightTile& light() const { return light_; }
  bool has(int row) const { return made_[static_cast<std::size_t>(row)].done(); }
  // Calls make(tile) unless the row is made; waits if another thread is making it.
  template <typename Make>
  void ensure_row(int row, const Make& make) const {
    made_[static_cast<std::size_t>(row)].run([&] { make(light_); });
  }

 private:
  mutable LightTile light_;
  mutable std::array<dem::Once, FieldPlane::kTileSide> made_;
};

LightTiles::LightTiles(std::size_t bytes)
    : tiles_(bytes / 2 / 3), patches_(bytes / 2 - bytes / 2 / 3), views_(bytes - bytes / 2) {}
LightTiles::~LightTiles() = default;
std::size_t LightTiles::bytes_of_tile() { return sizeof(CachedTile); }

// Relief of a field with the sunlight on it, from which its tiles are made.
struct LightTiles::Patch {
  Patch(std::shared_ptr<const Relief> field_relief, const FrameRequest& request, const GroundViewStore& store)
      : relief(std::move(field_relief)) {
    if (request.indirect.terrain) slopes.emplace(*relief, source_of(request), store);
    if (const auto& earth = request.indirect.earth)
      earth_disc.emplace(*relief, earth->direction, earth_radius_deg(earth->distance_m));
  }
  Patch(const Patch&) = delete;
  Patch& operator=(const Patch&) = delete;
  std::size_t bytes() const { return sizeof *this + relief->bytes() + (slopes ? slopes->bytes() : 0); }

  // Fills row `tile_row` of a tile. Its posts are those of the relief's finest grid in `row`, from `column` on,
  // `stride` columns apart. `keep_view`, `work`: see SlopeLight::gather().
  void fill_row(int row, int column, int stride, bool keep_view, std::size_t tile_row, LightTile& tile, LightWork& work,
                const StopToken& stop) const {
    static_assert(FieldPlane::kTileSide == kPacket);
    const Mat3f moon_from_grids = relief->axes().transpose().cast<float>();
    std::array<SectorLight, kPacket> row_light;
    for (SectorLight& light : row_light) {
      light.from.fill(Vec3f::zero());
      light.sky = Vec3f::zero();
    }
    if (slopes) slopes->gather(row, column, stride, row_light, stop, keep_view, &work);
    MarchLanes lanes = posts_in_row(*relief, row, column, stride);
    alignas(64) float earth_share[kPacket] = {};
    if (earth_disc) earth_disc->shares(0, stride, lanes, earth_share);
    float& max_ground_view = tile.max_ground_view[tile_row];
    for (int i = 0; i < kPacket; ++i) {
      const int post_column = column + i * stride;
      const auto relief_post = static_cast<std::size_t>(relief->grids().front().index(post_column, row));
      const SectorLight& light = row_light[static_cast<std::size_t>(i)];
      const Vec3f normal = moon_from_grids * relief->cell(0, relief_post).normal;
      const std::size_t tile_post = tile_row * kPacket + static_cast<std::size_t>(i);
      set_light(light, tile.posts[tile_post]);
      LightSum& sum = tile.posts[tile_post].sum;
      sum.ground = slopes ? slopes->radiosity(row, post_column, stop) : 0;
      sum.earth = earth_share[i];
      tile.ground[tile_post] = {normal,
                                static_cast<float>(static_cast<double>(lanes.height[i]) + relief->reference_m())};
      if (slopes && normal != Vec3f::zero())  // next to missing data there is no normal
        max_ground_view = std::clamp(1 - normal.dot(light.sky) / std::numbers::pi_v<float>, max_ground_view, 1.F);
    }
  }

  const std::shared_ptr<const Relief> relief;
  std::optional<SlopeLight> slopes;   // light from terrain, on request
  std::optional<SkyDisc> earth_disc;  // on request
};

// Returns the field's relief, which all directions of the Sun share. Two threads that miss it at once both make it: the
// results are equal, and the later one stays.
std::shared_ptr<const Relief> LightTiles::relief(const LightField& field, const FieldPlane& plane,
                                                 const dem::Terrain& terrain, const StopToken& stop) {
  const ContentKey key = key_of(terrain, field);
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(reliefs_, [](const auto& entry) { return entry.second.expired(); });
    if (const auto entry = reliefs_.find(key); entry != reliefs_.end())
      if (auto relief = entry->second.lock()) return relief;
  }
  const ReliefShape shape{
      .centre = plane.centre(), .half_m = plane.half_m(), .spacing_m = dem::post_spacing_m(field.finest)};
  auto made = std::make_shared<const Relief>(shape, heights_of(terrain, stop), stop);
  const std::lock_guard lock(mutex_);
  reliefs_[key] = made;
  return made;
}

// Returns the field's patch for this light, from the cache or new.
std::shared_ptr<const LightTiles::Patch> LightTiles::patch(const LightField& field, const FieldPlane& plane,
                                                           const ContentKey& light, const TileInputs& inputs,
                                                           const StopToken& stop) {
  return patches_.get(
      key_of(light, field, -1),
      [&]() -> decltype(patches_)::Loaded {
        const GroundViewStore store{&views_, key_of(inputs.terrain, field)};
        const auto made =
            std::make_shared<const Patch>(relief(field, plane, inputs.terrain, stop), inputs.request, store);
        return {made, made->bytes()};
      },
      stop);
}

std::vector<std::shared_ptr<const LightTile>> LightTiles::get(const LightField& field, const FieldPlane& plane,
                                                              std::span<const TileRows> tiles, const TileInputs& inputs,
                                                              const StopToken& stop, LightTimes* times) {
  const FrameRequest rounded = on_lattice(inputs.request, plane.centre());
  const TileInputs rounded_inputs{inputs.terrain, rounded, inputs.tiles};
  const ContentKey light = key_of(rounded_inputs);
  struct MissingRow {
    const CachedTile* cached;
    int tile, row;
    bool keep_view;
  };
  // The field's share of the views that fit, in tiles: the first ones, so that the next Sun finds the same.
  const std::size_t fitting_tiles = views_.capacity() / kMeanViewBytes / FieldPlane::kTileSide,
                    tiles_with_views =
                        inputs.tiles <= fitting_tiles ? tiles.size() : tiles.size() * fitting_tiles / inputs.tiles;
  std::vector<std::shared_ptr<const LightTile>> out;
  std::vector<MissingRow> missing;
  for (const TileRows& tile : tiles) {
    const std::shared_ptr<const CachedTile> cached = tiles_.get(
        key_of(light, field, tile.tile),
        []() -> decltype(tiles_)::Loaded {
          return {std::make_shared<const CachedTile>(), sizeof(CachedTile)};
        },
        stop);
    for (int row = 0; row < FieldPlane::kTileSide; ++row)
      if (tile.has(row) && !cached->has(row))
        missing.push_back({cached.get(), tile.tile, row, out.size() < tiles_with_views});
    out.emplace_back(cached, &cached->light());
  }
  if (missing.empty()) return out;
  Stopwatch watch;
  const std::shared_ptr<const Patch> source_patch = patch(field, plane, light, rounded_inputs, stop);
  if (times) times->relief_ms += watch.lap_ms();
  const int stride = field.stride(), half_tiles = plane.tiles() / 2;
  // Returns the relief's row (or column) of the first post of a row (or column) of tiles.
  const auto first_post = [&](int tile_index) {
    return source_patch->relief->middle() + (tile_index - half_tiles) * FieldPlane::kTileQuads * stride;
  };
  LightWork work;
  std::atomic<double> rows_ms{0};
  in_parallel(missing.size(), [&](std::size_t i) {
    Stopwatch row_watch;
    const auto [cached, tile_number, row, keep_view] = missing[i];
    const int south = first_post(tile_number / plane.tiles()), west = first_post(tile_number % plane.tiles());
    cached->ensure_row(row, [&, row = row, keep_view = keep_view](LightTile& tile) {
      source_patch->fill_row(south + row * stride, west, stride, keep_view, static_cast<std::size_t>(row), tile, work,
                             stop);
    });
    rows_ms += row_watch.lap_ms();
  });
  if (times) add_shares(work, rows_ms, watch.lap_ms(), *times);
  return out;
}

}  // namespace selenograph::engine
