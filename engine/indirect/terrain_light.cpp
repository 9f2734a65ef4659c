#include "engine/indirect/terrain_light.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "dem/support/error.h"
#include "dem/support/parallel.h"
#include "dem/terrain/surface_place.h"
#include "engine/indirect/fields_in_view.h"
#include "engine/radiometry/earth.h"

namespace selenograph::engine {
namespace {

constexpr LightPost kNoLight[2]{};
constexpr LightPlace kNowhere{kNoLight, 0, 0, 0};

}  // namespace

TerrainLight::TerrainLight(const FrameRequest& request, const RowViews& views, const Vec3& eye_m, const Mesh& mesh,
                           const dem::Terrain& terrain, double direct_w_m2, LightTiles& tiles, const StopToken& stop)
    : request_(request), mesh_(mesh), direct_w_m2_(direct_w_m2) {
  if (request.indirect.earth) {
    earth_ = request.indirect.earth->direction;
    earth_w_m2_ = direct_w_m2 * earth_over_sun(*request.indirect.earth, request.sun, band_of(request));
  }
  FieldsInView seen = fields_in_view(mesh, views, terrain, request.indirect.spacing_px);
  of_block_ = std::move(seen.of_block);
  if (seen.tiles() * LightTiles::kBytesOfTile > tiles.capacity())
    throw TooMuchTerrain(
        fmt::format("the frame's indirect light is gathered in {} tiles, more than the {} MB for them hold: "
                    "a larger \"spacing_px\" takes fewer",
                    seen.tiles(), tiles.capacity() >> 20),
        "indirect");
  tiles_.resize(seen.tiles());
  const Brdf brdf(request.reflectance, band_of(request));
  std::size_t next = 0;
  for (const FieldsInView::Field& field : seen.fields) {
    stop.check();
    const auto kept = tiles.get(field.id, field.plane, field.tiles, {terrain, request}, stop);
    const auto side = static_cast<std::size_t>(field.plane.tiles());
    Field& own = fields_.emplace_back(Field{field.plane, std::vector<const Tile*>(side * side)});
    in_parallel(kept.size(),
                [&](std::size_t i) { fill(*kept[i], field.plane, field.tiles[i], eye_m, brdf, tiles_[next + i]); });
    for (const int tile : field.tiles) own.tiles[static_cast<std::size_t>(tile)] = &tiles_[next++];
  }
}

void TerrainLight::fill(const LightTile& from, const FieldPlane& plane, int tile, const Vec3& eye_m, const Brdf& brdf,
                        Tile& out) const {
  constexpr int kSide = FieldPlane::kTileSide;
  const int row = tile / plane.tiles() * FieldPlane::kTileQuads, column = tile % plane.tiles() * FieldPlane::kTileQuads;
  for (int i = 0; i < kSide * kSide; ++i) {
    const TilePost& post = from.posts[static_cast<std::size_t>(i)];
    const Vec3 place =
        plane.direction(column + i % kSide, row + i / kSide) * (kMoonRadius_m + static_cast<double>(post.height_m));
    out[static_cast<std::size_t>(i)] = fill(post, (eye_m - place).normalized(), brdf);
  }
}

LightPost TerrainLight::fill(const TilePost& post, const Vec3& toward, const Brdf& brdf) const {
  LightPost out{.earth = static_cast<float>(earth_w_m2_) * post.earth,
                .ground = static_cast<float>(direct_w_m2_) * post.radiosity};
  Vec3 sum = Vec3::Zero();
  double lengths[kSectors], fluence = 0;
  for (std::size_t k = 0; k < kSectors; ++k) {
    sum += post.light.from[k].cast<double>();
    fluence += lengths[k] = static_cast<double>(post.light.from[k].norm());
  }
  if (!(fluence > 0)) return out;
  const Vec3 normal = post.normal.cast<double>();
  // A lane per sector, and one for all of them.
  double mu0[kPacket], mu[kPacket], cos_phase[kPacket], reflected[kPacket];
  std::fill_n(mu0, kPacket, 1e-9), std::fill_n(mu, kPacket, std::max(normal.dot(toward), 0.05)),
      std::fill_n(cos_phase, kPacket, 0.0);
  for (int k = 0; k <= kSectors; ++k) {
    const Vec3 from = k < kSectors ? post.light.from[static_cast<std::size_t>(k)].cast<double>() : sum;
    const double length = k < kSectors ? lengths[k] : fluence;
    if (!(length > 0)) continue;
    mu0[k] = std::max(normal.dot(from) / length, 1e-9), cos_phase[k] = toward.dot(from) / length;
  }
  brdf.times_mu0(mu0, mu, cos_phase, nullptr, reflected);
  // The mean reflectance of the light that arrives, over that of light from one direction.
  double exact = 0, arrives = 0;
  for (int k = 0; k < kSectors; ++k)
    if (mu0[k] > 1e-9) exact += lengths[k] * reflected[k], arrives += lengths[k] * mu0[k];
  const double simple = arrives * reflected[kSectors] / mu0[kSectors];
  const auto scaled = [&](double value) { return static_cast<float>(value * direct_w_m2_); };
  out.x = scaled(sum.x()), out.y = scaled(sum.y()), out.z = scaled(sum.z()), out.fluence = scaled(fluence);
  out.factor = simple > 0 && exact > 0 ? static_cast<float>(std::clamp(exact / simple, 0.25, 4.0)) : 1;
  return out;
}

LightPlace TerrainLight::place_of(std::uint32_t block, const Vec3& place_m) const {
  if (of_block_[block] < 0) return kNowhere;
  const Field& field = fields_[static_cast<std::size_t>(of_block_[block])];
  constexpr int kQuads = FieldPlane::kTileQuads;
  const int tiles = field.plane.tiles();
  const Eigen::Vector2d place = field.plane.place(place_m);
  const double last = tiles * kQuads, x = std::clamp(place.x(), 0.0, last), y = std::clamp(place.y(), 0.0, last);
  const int column = std::min(static_cast<int>(x), tiles * kQuads - 1),
            row = std::min(static_cast<int>(y), tiles * kQuads - 1);
  const Tile* tile = field.tiles[static_cast<std::size_t>(row / kQuads * tiles + column / kQuads)];
  if (!tile) return kNowhere;
  const int post = row % kQuads * FieldPlane::kTileSide + column % kQuads;
  return {tile->data() + post, static_cast<float>(x - column), static_cast<float>(y - row), FieldPlane::kTileSide};
}

LightPost TerrainLight::at(std::uint32_t block, const Vec3& place_m) const {
  const LightPlace place = place_of(block, place_m);
  LightPost post;
  posts_between({&place, 1}, &post);
  return post;
}

void TerrainLight::add(const SurfacePoints& points, const Shading& shading, const Rays& rays, const Brdf& brdf,
                       const double* albedo, float* radiance) const {
  const bool hapke = request_.reflectance.model == ReflectanceModel::hapke;
  const double *w = hapke ? albedo : nullptr, *factor = hapke ? nullptr : albedo;
  LightPlace places[kPacket];
  LightPost posts[kPacket];
  alignas(64) double mu[kPacket], reflected[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    mu[i] = shading.mu[i] > 0 ? shading.mu[i] : 0;
    places[i] = points.hit[i] ? place_of(points.triangle[i].block(), points.position(i)) : kNowhere;
  }
  posts_between(places, posts);
  DiffuseLanes light;
  light_from_terrain(posts, points, shading, rays, light);
  brdf.times_mu0(light.mu0, mu, light.cos_phase, w, reflected);
  add_reflected(light, reflected, factor, radiance);
  if (!(earth_w_m2_ > 0)) return;
  light_from_earth(posts, points, shading, rays, earth_, light);
  brdf.times_mu0(light.mu0, mu, light.cos_phase, w, reflected);
  add_reflected(light, reflected, factor, radiance);
}

IndirectIrradiance TerrainLight::irradiance(const SurfacePoints& points, int lane, const Vec3& normal) const {
  const LightPost post = at(points.triangle[lane].block(), points.position(lane));
  const Vec3 from(static_cast<double>(post.x), static_cast<double>(post.y), static_cast<double>(post.z));
  return {std::max(normal.dot(from), 0.0), static_cast<double>(post.earth) * std::max(normal.dot(earth_), 0.0)};
}

IndirectIrradiance TerrainLight::Place::on(const Vec3& normal) const {
  // Of level ground, a plane with that normal sees (1 - cos) / 2 of its hemisphere.
  return {std::max(normal.dot(terrain), 0.0) + ground * (1 - normal.dot(up)) / 2, std::max(normal.dot(earth), 0.0)};
}

TerrainLight::Place TerrainLight::on_objects(const Vec3& place_m) const {
  Place out;
  const Geographic g = to_geographic(place_m);
  const dem::Ticks ticks = dem::ticks_of(g.lat_deg, g.lon_deg);
  out.up = place_m.normalized();
  const auto block = mesh_.block_at(ticks.whole_lat, ticks.whole_lon);
  if (!block) return out;
  const LightPost post = at(*block, place_m);
  out.terrain = {static_cast<double>(post.x), static_cast<double>(post.y), static_cast<double>(post.z)};
  out.earth = static_cast<double>(post.earth) * earth_;
  out.ground = static_cast<double>(post.ground);
  return out;
}

}  // namespace selenograph::engine
