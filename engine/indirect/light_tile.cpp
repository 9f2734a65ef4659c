#include "engine/indirect/light_tile.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "dem/support/parallel.h"
#include "dem/terrain/surface_place.h"
#include "engine/indirect/terrain_heights.h"
#include "engine/radiometry/earth.h"
#include "engine/radiometry/mapped_surface.h"

namespace selenograph::engine {
namespace {

// Unit directions of a tile's posts.
std::vector<Vec3> directions_of(const dem::BlockExtent& extent) {
  std::vector<Vec3> out;
  for (int r = 0; r <= extent.quads; ++r)
    for (int c = 0; c <= extent.quads; ++c)
      out.push_back(to_cartesian({dem::lat_deg_of(extent.lat0 + r * extent.lat_step),
                                  dem::lon_deg_of(dem::wrap_lon(std::int64_t{extent.lon0} + c * extent.lon_step)), 0})
                        .normalized());
  return out;
}

ReliefShape shape_of(const dem::BlockId& block, const std::vector<Vec3>& directions, const dem::Terrain& terrain) {
  ReliefShape shape;
  const dem::BlockExtent e = dem::extent_of(block);
  shape.centre = to_cartesian({dem::lat_deg_of(e.lat0 + e.quads / 2 * e.lat_step),
                               dem::lon_deg_of(e.lon0 + e.quads / 2 * e.lon_step), 0})
                     .normalized();
  double cosine = 1;
  for (const Vec3& d : directions) cosine = std::min(cosine, d.dot(shape.centre));
  shape.half_m = kMoonRadius_m * std::sqrt(1 - cosine * cosine) / cosine;
  const int finest = std::clamp(terrain.posts_level(block), block.level, block.level + kFiner);
  shape.spacing_m = dem::post_spacing_m(finest);
  return shape;
}

GroundAlbedo albedo_of(const FrameRequest& request, const StopToken& stop) {
  if (request.albedo_maps.empty()) return {};
  return
      [known = AlbedoMaps(request), &stop](double size_m, std::span<const Vec3> directions, std::span<float> albedo) {
        std::vector<ScaledMap> maps = known.sampled(stop);
        for (std::size_t i = 0; i < directions.size(); ++i) {
          const Geographic place = to_geographic(directions[i]);
          double sum = 0;
          parts_of(maps, {place.lat_deg, place.lon_deg, {size_m, 0}, {0, size_m}}, known.fallback(),
                   [&](double value, double share) { sum += share * std::clamp(value, 0.0, known.most()); });
          albedo[i] = static_cast<float>(sum);
        }
      };
}

std::shared_ptr<LightTile> make_tile(const dem::BlockId& block, const TileLight& of, const StopToken& stop) {
  const FrameRequest& request = of.request;
  auto tile = std::make_shared<LightTile>();
  tile->extent = dem::extent_of(block);
  const std::vector<Vec3> directions = directions_of(tile->extent);
  const Relief relief(shape_of(block, directions, of.terrain), heights_of(of.terrain, stop), stop);
  std::vector<SectorLight> light(directions.size());
  std::vector<float> radiosity(directions.size());
  if (request.indirect.terrain) {
    Reflectance reflectance = request.reflectance;
    const bool hapke = reflectance.model == ReflectanceModel::hapke;
    if (!request.albedo_maps.empty()) reflectance.rho = 1;
    const SlopeLight slopes(
        relief, {request.sun, 1, Brdf(reflectance, band_of(request)), hapke, albedo_of(request, stop)}, stop);
    slopes.gather(directions, light, stop);
    slopes.radiosities(directions, radiosity);
  }
  std::vector<float> earth(directions.size());
  if (request.indirect.earth)
    find_shares(relief,
                {relief, request.indirect.earth->direction, earth_radius_deg(request.indirect.earth->distance_m)},
                directions, earth, stop);
  std::vector<Relief::Cell> ground(directions.size());
  relief.ground(directions, ground);
  const Eigen::Matrix3f back = relief.axes().transpose().cast<float>();
  for (std::size_t i = 0; i < directions.size(); ++i)
    tile->posts.push_back({light[i], back * ground[i].normal,
                           static_cast<float>(static_cast<double>(ground[i].height) + relief.reference_m()),
                           radiosity[i], earth[i]});
  return tile;
}

ContentKey key_of(const dem::BlockId& block, const TileLight& of) {
  const FrameRequest& q = of.request;
  ContentHash hash;
  hash.add(block), hash.add(of.terrain.detail_number()), hash.add(q.indirect.terrain);
  if (q.indirect.terrain) {
    const Reflectance& r = q.reflectance;
    const HapkeParameters& h = r.hapke;
    hash.add(q.sun.direction);
    for (const double value : {q.sun.angular_radius_deg, r.lommel_seeliger_weight, r.rho, r.shininess,
                               r.limb_darkening.value_or(-1), h.w, h.b0, h.h, h.b, h.c, h.theta_bar_deg, h.bc0, h.hc})
      hash.add(value);
    hash.add(r.model), hash.add(r.phase), hash.add(r.ground), hash.add(h.phase_function), hash.add(h.terms);
    if (r.model == ReflectanceModel::moon && q.band)
      for (const ResponsePoint& p : q.band->response()) hash.add(p.wavelength_um), hash.add(p.response);
    for (const auto& map : q.albedo_maps) hash.add(map->fingerprint());
  }
  if (q.indirect.earth) hash.add(q.indirect.earth->direction), hash.add(q.indirect.earth->distance_m);
  return hash.key();
}

}  // namespace

std::shared_ptr<const LightTile> LightTiles::get(const dem::BlockId& block, const TileLight& of,
                                                 const StopToken& stop) {
  return tiles_.get(
      key_of(block, of),
      [&]() -> decltype(tiles_)::Loaded {
        auto tile = make_tile(block, of, stop);
        const std::size_t bytes = tile->bytes();
        return {std::move(tile), bytes};
      },
      stop);
}

}  // namespace selenograph::engine
