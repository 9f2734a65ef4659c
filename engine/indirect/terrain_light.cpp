#include "engine/indirect/terrain_light.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "dem/support/error.h"
#include "dem/support/parallel.h"
#include "dem/terrain/surface_place.h"
#include "engine/indirect/fields_in_view.h"
#include "engine/radiometry/earth.h"

namespace selenograph::engine {
namespace {

constexpr LightPost kNoLight[2];
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
  const FrameRequest gathered = on_lattice(request);
  std::size_t next = 0;
  for (const FieldsInView::Field& field : seen.fields) {
    stop.check();
    const auto kept = tiles.get(field.id, field.plane, field.tiles, {terrain, gathered}, stop);
    for (const auto& tile : kept)
      most_ground_view_ = std::max(most_ground_view_, static_cast<double>(tile->most_ground_view));
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
  static_assert(kSide == kPacket);
  const int row = tile / plane.tiles() * FieldPlane::kTileQuads, column = tile % plane.tiles() * FieldPlane::kTileQuads;
  for (int r = 0; r < kSide; ++r) {
    const auto first = static_cast<std::size_t>(r * kSide);
    const auto posts = std::span(from.posts).subspan(first).first<kPacket>();
    Vec3 toward[kPacket];
    for (int i = 0; i < kSide; ++i) {
      const double radius = kMoonRadius_m + static_cast<double>(posts[static_cast<std::size_t>(i)].height_m);
      toward[i] = (eye_m - plane.direction(column + i, row + r) * radius).normalized();
    }
    set_factors(posts, toward, brdf, std::span(out).subspan(first).first<kPacket>());
  }
}

// Sixteen posts. The factor is the mean reflectance of the light that arrives, over that of light from one direction.
void TerrainLight::set_factors(std::span<const TilePost, kPacket> from, const Vec3 (&toward)[kPacket], const Brdf& brdf,
                               std::span<LightPost, kPacket> out) const {
  alignas(64) double mu[kPacket], mu0[kPacket], cos_phase[kPacket], reflected[kPacket];
  double exact[kPacket] = {}, arrives[kPacket] = {};
  for (int i = 0; i < kPacket; ++i) {
    const TilePost& post = from[static_cast<std::size_t>(i)];
    out[static_cast<std::size_t>(i)] = light_post(post, direct_w_m2_, earth_w_m2_);
    mu[i] = std::max(post.normal.cast<double>().dot(toward[i]), 0.05);
  }
  for (std::size_t k = 0; k < kSectors; ++k) {
    float lengths[kPacket];
    for (int i = 0; i < kPacket; ++i) {
      const TilePost& post = from[static_cast<std::size_t>(i)];
      const Eigen::Vector3f light = post.from[k] * static_cast<float>(direct_w_m2_);
      lengths[i] = light.norm();
      const bool faces = lengths[i] > 0 && post.normal.dot(light) > 1e-9F * lengths[i];
      mu0[i] = faces ? static_cast<double>(post.normal.dot(light) / lengths[i]) : 1e-9;
      cos_phase[i] = faces ? toward[i].dot(light.cast<double>()) / static_cast<double>(lengths[i]) : 0;
      if (!faces) lengths[i] = 0;
    }
    brdf.times_mu0(mu0, mu, cos_phase, nullptr, reflected);
    for (int i = 0; i < kPacket; ++i) {
      exact[i] += static_cast<double>(lengths[i]) * reflected[i];
      arrives[i] += static_cast<double>(lengths[i]) * mu0[i];
    }
  }
  for (int i = 0; i < kPacket; ++i) {
    const LightPost& post = out[static_cast<std::size_t>(i)];
    const auto fluence = static_cast<double>(post.fluence);
    mu0[i] = arrives[i] > 0 ? arrives[i] / fluence : 1e-9;
    const Vec3 sum(static_cast<double>(post.x), static_cast<double>(post.y), static_cast<double>(post.z));
    cos_phase[i] = fluence > 0 ? toward[i].dot(sum) / fluence : 0;
  }
  brdf.times_mu0(mu0, mu, cos_phase, nullptr, reflected);
  for (int i = 0; i < kPacket; ++i) {
    LightPost& post = out[static_cast<std::size_t>(i)];
    const double simple = static_cast<double>(post.fluence) * reflected[i];
    if (simple > 0 && exact[i] > 0) post.factor = static_cast<float>(std::clamp(exact[i] / simple, 0.25, 4.0));
  }
}

void TerrainLight::places_of(const SurfacePoints& points, LightPlace (&places)[kPacket]) const {
  std::fill_n(places, kPacket, kNowhere);
  FieldLanes at;
  const std::uint32_t hits = hit_bits(points);
  const bool one_block = in_one_block(points.triangle);
  // All are mostly in one field.
  for (std::uint32_t left = hits; left;) {
    const int of = of_block_[points.triangle[std::countr_zero(left)].block()];
    std::uint32_t here = left;
    for (std::uint32_t i = 0; i < kPacket && !one_block; ++i)
      if (of_block_[points.triangle[i].block()] != of) here &= ~(1U << i);
    left &= ~here;
    if (of < 0) continue;
    const Field& field = fields_[static_cast<std::size_t>(of)];
    places_in_field(field.plane, points, hits == kAllLanes, at);
    for (std::uint32_t i = 0; i < kPacket; ++i)
      if (const Tile* tile = here >> i & 1 ? field.tiles[static_cast<std::size_t>(at.tile[i])] : nullptr)
        places[i] = {tile->data() + at.post[i], at.east[i], at.north[i], FieldPlane::kTileSide};
  }
}

LightPlace TerrainLight::at(std::uint32_t block, const Vec3& place_m) const {
  if (of_block_[block] < 0) return kNowhere;
  const Field& field = fields_[static_cast<std::size_t>(of_block_[block])];
  const FieldPost at = field.plane.post_at(place_m);
  const Tile* tile = field.tiles[static_cast<std::size_t>(at.tile)];
  if (!tile) return kNowhere;
  constexpr int kSide = FieldPlane::kTileSide;
  return {tile->data() + at.row * kSide + at.column, static_cast<float>(at.east), static_cast<float>(at.north), kSide};
}

void TerrainLight::add(const SurfacePoints& points, const Shading& shading, const Rays& rays, const Brdf& brdf,
                       const double* albedo, float* radiance) const {
  const bool hapke = request_.reflectance.model == ReflectanceModel::hapke;
  const double *w = hapke ? albedo : nullptr, *factor = hapke ? nullptr : albedo;
  alignas(64) double mu[kPacket], reflected[kPacket];
  for (int i = 0; i < kPacket; ++i) mu[i] = shading.mu[i] > 0 ? shading.mu[i] : 0;
  LightPlace places[kPacket];
  places_of(points, places);
  DiffuseLanes light;
  float earth[kPacket];
  light_from_terrain(places, points, shading, rays, light, earth);
  brdf.times_mu0(light.mu0, mu, light.cos_phase, w, reflected);
  add_reflected(light, reflected, factor, radiance);
  if (!(earth_w_m2_ > 0)) return;
  light_from_earth(earth, points, shading, rays, earth_, light);
  brdf.times_mu0(light.mu0, mu, light.cos_phase, w, reflected);
  add_reflected(light, reflected, factor, radiance);
}

Irradiance TerrainLight::irradiance(const SurfacePoints& points, int lane, const Vec3& normal) const {
  return irradiance_at(at(points.triangle[lane].block(), points.position(lane)), normal, earth_);
}

Irradiance TerrainLight::Place::on(const Vec3& normal) const {
  // Of level ground, a plane with that normal sees (1 - cos) / 2 of its hemisphere.
  return {0, std::max(normal.dot(terrain), 0.0) + ground * (1 - normal.dot(up)) / 2, std::max(normal.dot(earth), 0.0)};
}

TerrainLight::Place TerrainLight::on_objects(const Vec3& place_m) const {
  Place out;
  const Geographic g = to_geographic(place_m);
  const dem::Ticks ticks = dem::ticks_of(g.lat_deg, g.lon_deg);
  out.up = place_m.normalized();
  const auto block = mesh_.block_at(ticks.whole_lat, ticks.whole_lon);
  if (!block) return out;
  const LightPost post = post_between(at(*block, place_m));
  out.terrain = {static_cast<double>(post.x), static_cast<double>(post.y), static_cast<double>(post.z)};
  out.earth = static_cast<double>(post.earth) * earth_;
  out.ground = static_cast<double>(post.ground);
  return out;
}

}  // namespace selenograph::engine
