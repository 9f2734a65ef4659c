#include "engine/indirect/terrain_light.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <utility>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "engine/indirect/light_factors.h"

namespace selenograph::engine {

TerrainLight::TerrainLight(const FrameRequest& request, const ViewOfGround& view, const std::optional<Vec3>& viewer_m,
                           const dem::Terrain& terrain, double direct_w_m2, LightTiles& tiles, const StopToken& stop)
    : request_(request), mesh_(view.mesh), sources_(light_sources(request, direct_w_m2)) {
  FieldsInView fields = fields_in_view(view, terrain, request.indirect.spacing_px);
  field_of_block_ = std::move(fields.field_of_block);
  field_of_object_ = std::move(fields.field_of_object);
  fade_ = fields.fade;
  for (const Ball& object : view.objects) objects_m_.push_back(object.centre_m);
  if (fields.tiles() * (LightTiles::bytes_of_tile() + sizeof(Tile)) > tiles.capacity())
    throw TooMuchTerrain(
        fmt::format("the frame's indirect light is gathered in {} tiles, more than the {} MB for them hold: "
                    "a larger \"spacing_px\" takes fewer",
                    fields.tiles(), tiles.capacity() >> 20),
        "indirect");
  tiles_.resize(fields.tiles());
  const Brdf brdf(request.reflectance, band_of(request));
  const Viewer viewer{view.views, viewer_m};
  std::size_t next_tile = 0;  // index in tiles_ of the field's first tile
  for (const FieldsInView::Field& field : fields.fields) {
    stop.check();
    auto light_tiles = tiles.get(field.id, field.plane, field.tiles, {terrain, request, fields.tiles()}, stop, &times_);
    const auto side = static_cast<std::size_t>(field.plane.tiles());
    Field& new_field = fields_.emplace_back(Field{field.plane, std::vector<const Tile*>(side * side)});
    in_parallel(light_tiles.size(), [&](std::size_t i) {
      Tile& tile = tiles_[next_tile + i];
      tile.light = std::move(light_tiles[i]);
      tile.rows = field.tiles[i];
      set_factors(*tile.light, field.plane, tile.rows, viewer, brdf, tile.factors);
    });
    for (const TileRows& rows : field.tiles) {
      const Tile& tile = tiles_[next_tile++];
      new_field.tiles[static_cast<std::size_t>(rows.tile)] = &tile;
      for (int row = 0; row < FieldPlane::kTileSide; ++row)
        if (rows.has(row))
          max_ground_view_ = std::max(max_ground_view_,
                                      static_cast<double>(tile.light->max_ground_view[static_cast<std::size_t>(row)]));
    }
  }
}

void TerrainLight::read(const SurfacePoints& points, const Shading& shading, TerrainLanes& out) const {
  FieldLanes positions;
  const std::uint32_t hits = hit_bits(points);
  const bool share_block = in_one_block(points.triangle);
  // Handle the lanes field by field and tile by tile: mostly all share one. Sets of lanes are bit masks.
  for (std::uint32_t remaining = hits; remaining;) {
    const int field_index = field_of_block_[points.triangle[std::countr_zero(remaining)].block()];
    std::uint32_t in_field = remaining;
    for (std::uint32_t i = 0; i < kPacket && !share_block; ++i)
      if (field_of_block_[points.triangle[i].block()] != field_index) in_field &= ~(1U << i);
    remaining &= ~in_field;
    if (field_index < 0) {  // no posts of light: there is only earthlight, as over level ground
      for (std::uint32_t lanes = sources_.earth_w_m2 > 0 ? in_field : 0; lanes; lanes &= lanes - 1) {
        const int i = std::countr_zero(lanes);
        out.earth[i] = static_cast<float>(sources_.earth_above_level(points.position(i)));
      }
      continue;
    }
    const Field& field = fields_[static_cast<std::size_t>(field_index)];
    set_field_lanes(field.plane, points, positions);
    while (in_field) {
      const int tile_number = positions.tile[std::countr_zero(in_field)];
      std::uint32_t in_tile = 0;
      for (std::uint32_t i = 0; i < kPacket; ++i) in_tile |= (positions.tile[i] == tile_number ? 1U : 0U) << i;
      if (const Tile* tile = field.tiles[static_cast<std::size_t>(tile_number)])
        read_posts(tile->light->posts.data(), tile->factors.data(), positions, in_field & in_tile, shading, out);
      in_field &= ~in_tile;
    }
  }
  // Fade the light from terrain with distance; earthlight does not fade.
  for (std::uint32_t lanes = fade_ ? hits : 0; lanes; lanes &= lanes - 1) {
    const int i = std::countr_zero(lanes);
    const auto share = static_cast<float>(fade_->share(points.position(i)));
    for (float* values : {out.arrives, out.x, out.y, out.z, out.fluence}) values[i] *= share;
  }
}

std::optional<BetweenPosts> TerrainLight::posts_at(int field_index, const Vec3& position_m) const {
  if (field_index < 0) return std::nullopt;
  const Field& field = fields_[static_cast<std::size_t>(field_index)];
  const FieldPost position = field.plane.post_at(position_m);
  const Tile* tile = field.tiles[static_cast<std::size_t>(position.tile)];
  if (!tile || !tile->rows.has(position.row) || !tile->rows.has(position.row + 1)) return std::nullopt;
  const auto post = static_cast<std::size_t>(position.row * FieldPlane::kTileSide + position.column);
  return BetweenPosts{&tile->light->posts[post], static_cast<float>(position.east), static_cast<float>(position.north)};
}

void TerrainLight::add(const SurfacePoints& points, const Shading& shading, const Rays& rays, const Brdf& brdf,
                       const double* albedo, float* radiance) const {
  const bool hapke = request_.reflectance.model == ReflectanceModel::hapke;
  const double *w = hapke ? albedo : nullptr, *factor = hapke ? nullptr : albedo;
  alignas(64) double mu[kPacket];
  alignas(64) double reflected[kPacket];
  for (int i = 0; i < kPacket; ++i) mu[i] = shading.mu[i] > 0 ? shading.mu[i] : 0;
  TerrainLanes lanes;
  read(points, shading, lanes);
  DiffuseLanes light;
  light_from_terrain(lanes, rays, sources_.sun_w_m2, light);
  brdf.times_mu0(light.mu0, mu, light.cos_phase, w, reflected);
  add_reflected(light, reflected, factor, radiance);
  if (!(sources_.earth_w_m2 > 0)) return;
  light_from_earth(lanes, points, shading, rays, sources_, light);
  brdf.times_mu0(light.mu0, mu, light.cos_phase, w, reflected);
  add_reflected(light, reflected, factor, radiance);
}

Irradiance TerrainLight::irradiance(const SurfacePoints& points, int lane, const Vec3& normal) const {
  const Vec3 position_m = points.position(lane);
  const auto posts = posts_at(field_of_block_[points.triangle[lane].block()], position_m);
  if (!posts) return irradiance_on_level(position_m, normal, sources_);
  Irradiance out = irradiance_at(*posts, normal, sources_);
  if (fade_) out.terrain_w_m2 *= fade_->share(position_m);
  return out;
}

Irradiance TerrainLight::ObjectLight::on(const Vec3& normal) const {
  // A plane with this normal sees level ground in (1 - cos) / 2 of its hemisphere.
  return {0, std::max(normal.dot(terrain), 0.0) + ground * std::max(1 - normal.dot(up), 0.0) / 2,
          std::max(normal.dot(earth), 0.0)};
}

std::optional<BetweenPosts> TerrainLight::below(const Vec3& position_m, std::size_t object) const {
  const auto block = mesh_.block_at(position_m);
  if (const auto posts = posts_at(block ? field_of_block_[*block] : -1, position_m);
      posts || object >= field_of_object_.size())
    return posts;
  const auto posts = posts_at(field_of_object_[object], position_m);
  return posts ? posts : posts_at(field_of_object_[object], objects_m_[object]);
}

TerrainLight::ObjectLight TerrainLight::on_objects(const Vec3& position_m, std::size_t object) const {
  ObjectLight out;
  out.up = position_m.normalized();
  const auto posts = below(position_m, object);
  if (!posts) {
    out.earth = sources_.earth_w_m2 * sources_.earth_above_level(position_m) * sources_.earth;
    return out;
  }
  const LightSum post = sum_between(*posts);
  out.terrain =
      sources_.sun_w_m2 * Vec3(static_cast<double>(post.x), static_cast<double>(post.y), static_cast<double>(post.z));
  out.earth = sources_.earth_w_m2 * static_cast<double>(post.earth) * sources_.earth;
  out.ground = sources_.sun_w_m2 * static_cast<double>(post.ground);
  const double share = fade_ ? fade_->share(position_m) : 1;
  out.terrain *= share;
  out.ground *= share;
  return out;
}

}  // namespace selenograph::engine
