#include "engine/indirect/terrain_light.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "dem/support/error.h"
#include "dem/support/parallel.h"
#include "dem/terrain/surface_place.h"
#include "engine/radiometry/earth.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {
namespace {

// The level of the posts for a block in view: none where its pixels are too large, or nobody sees it.
int level_for(const MeshBlock& block, const RowViews& views, double spacing_px) {
  const dem::BlockId& id = block.posts->id;
  const NodeBounds bounds =
      bounds_of(id, static_cast<double>(block.posts->min_m), static_cast<double>(block.posts->max_m));
  double pixels_per_m = 0;
  for (const ViewBundle& view : views.bundles())
    if (view.may_see(bounds.centre, bounds.radius_m) && !below_horizon(view.view.position(), bounds, view.shift_m))
      pixels_per_m = std::max(pixels_per_m, view.pixels_per_metre(bounds.centre, bounds.radius_m));
  if (!(pixels_per_m * TerrainLight::kLargestPixel_m >= 1)) return -1;
  const double level = std::floor(std::log2(dem::post_spacing_m(0) * pixels_per_m / spacing_px));
  return std::max(dem::kRootLevel, static_cast<int>(std::clamp<double>(level, id.level - kFiner, id.level)));
}

}  // namespace

TerrainLight::TerrainLight(const FrameRequest& request, const RowViews& views, const Vec3& eye_m, const Mesh& mesh,
                           const dem::Terrain& terrain, double direct_w_m2, LightTiles& tiles, const StopToken& stop)
    : request_(request), mesh_(mesh), direct_w_m2_(direct_w_m2) {
  if (request.indirect.earth) {
    earth_ = request.indirect.earth->direction;
    earth_w_m2_ = direct_w_m2 * earth_over_sun(*request.indirect.earth, request.sun, band_of(request));
  }
  std::vector<dem::BlockId> of_blocks(mesh.blocks().size(), dem::BlockId{-1, 0, 0});
  in_parallel_pieces(of_blocks.size(), 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) {
      const MeshBlock& block = mesh.blocks()[i];
      const int level = level_for(block, views, request.indirect.spacing_px);
      if (level >= 0) of_blocks[i] = dem::ancestor_of(block.posts->id, std::min(level, block.posts->id.level));
    }
  });
  std::vector<dem::BlockId> tile_ids;
  for (const dem::BlockId& id : of_blocks)
    if (id.level >= 0) tile_ids.push_back(id);
  std::sort(tile_ids.begin(), tile_ids.end());
  tile_ids.erase(std::unique(tile_ids.begin(), tile_ids.end()), tile_ids.end());
  const Brdf brdf(request.reflectance, band_of(request));
  if (tile_ids.size() * LightTiles::kBytesOfTile > tiles.capacity())
    throw TooMuchTerrain(
        fmt::format("the frame's indirect light is gathered in {} blocks, more than the {} MB for them hold: "
                    "a larger \"spacing_px\" takes fewer",
                    tile_ids.size(), tiles.capacity() >> 20),
        "indirect");
  for (const dem::BlockId& id : tile_ids) {
    stop.check();
    tiles_.push_back({tiles.get(id, {terrain, request}, stop), {}});
  }
  in_parallel(tiles_.size(), [&](std::size_t i) { fill(tiles_[i], eye_m, brdf); });
  link(of_blocks, tile_ids);
}

void TerrainLight::link(const std::vector<dem::BlockId>& of_blocks, const std::vector<dem::BlockId>& tile_ids) {
  places_.resize(of_blocks.size());
  for (std::size_t i = 0; i < of_blocks.size(); ++i) {
    const auto found = std::lower_bound(tile_ids.begin(), tile_ids.end(), of_blocks[i]);
    if (found == tile_ids.end() || *found != of_blocks[i]) continue;
    const Tile& tile = tiles_[static_cast<std::size_t>(found - tile_ids.begin())];
    const dem::BlockExtent &own = mesh_.blocks()[i].posts->extent, &wide = tile.light->extent;
    const auto scale = [](std::int32_t step, std::int32_t of) {
      return static_cast<float>(step) / static_cast<float>(of);
    };
    places_[i] = {tile.posts.data(),
                  wide.quads + 1,
                  scale(own.lat0 - wide.lat0, wide.lat_step),
                  scale(own.lon0 - wide.lon0, wide.lon_step),
                  scale(own.lat_step, wide.lat_step),
                  scale(own.lon_step, wide.lon_step)};
  }
}

void TerrainLight::fill(Tile& tile, const Vec3& eye_m, const Brdf& brdf) const {
  const LightTile& light = *tile.light;
  const int side = light.extent.quads + 1;
  tile.posts.resize(light.posts.size());
  for (std::size_t i = 0; i < light.posts.size(); ++i) {
    const TilePost& post = light.posts[i];
    Post& out = tile.posts[i];
    out = {
        0, 0, 0, 0, 1, static_cast<float>(earth_w_m2_) * post.earth, static_cast<float>(direct_w_m2_) * post.radiosity};
    Vec3 sum = Vec3::Zero();
    double fluence = 0;
    for (const Eigen::Vector3f& from : post.light.from)
      sum += from.cast<double>(), fluence += static_cast<double>(from.norm());
    if (!(fluence > 0)) continue;
    const int row = static_cast<int>(i) / side, column = static_cast<int>(i) % side;
    const Vec3 place =
        to_cartesian({dem::lat_deg_of(light.extent.lat0 + row * light.extent.lat_step),
                      dem::lon_deg_of(dem::wrap_lon(std::int64_t{light.extent.lon0} + column * light.extent.lon_step)),
                      static_cast<double>(post.height_m)});
    const Vec3 toward = (eye_m - place).normalized(), normal = post.normal.cast<double>();
    // A lane per sector, and one for all of them.
    double mu0[kPacket], mu[kPacket], cos_phase[kPacket], reflected[kPacket];
    std::fill_n(mu0, kPacket, 1e-9), std::fill_n(mu, kPacket, std::max(normal.dot(toward), 0.05)),
        std::fill_n(cos_phase, kPacket, 0.0);
    double exact = 0;
    for (int k = 0; k <= kSectors; ++k) {
      const Vec3 from = k < kSectors ? post.light.from[static_cast<std::size_t>(k)].cast<double>() : sum;
      const double length = k < kSectors ? from.norm() : fluence;
      if (!(length > 0)) continue;
      mu0[k] = std::max(normal.dot(from) / length, 1e-9), cos_phase[k] = toward.dot(from) / length;
    }
    brdf.times_mu0(mu0, mu, cos_phase, nullptr, reflected);
    // The mean reflectance of the light that arrives, over that of light from one direction.
    double arrives = 0;
    for (std::size_t k = 0; k < kSectors; ++k)
      if (mu0[k] > 1e-9) {
        const double length = static_cast<double>(post.light.from[k].norm());
        exact += length * reflected[k], arrives += length * mu0[k];
      }
    const double simple = arrives * reflected[kSectors] / mu0[kSectors];
    const auto scaled = [&](double value) { return static_cast<float>(value * direct_w_m2_); };
    out.x = scaled(sum.x()), out.y = scaled(sum.y()), out.z = scaled(sum.z()), out.fluence = scaled(fluence);
    out.factor = simple > 0 && exact > 0 ? static_cast<float>(std::clamp(exact / simple, 0.25, 4.0)) : 1;
  }
}

TerrainLight::Post TerrainLight::between(std::uint32_t block, float row, float column) const {
  const BlockPlace& place = places_[block];
  if (!place.posts) return {0, 0, 0, 0, 1, 0, 0};
  const float y = std::clamp(place.row + row * place.scale_row, 0.F, static_cast<float>(place.side - 1)),
              x = std::clamp(place.column + column * place.scale_column, 0.F, static_cast<float>(place.side - 1));
  const int r = std::min(static_cast<int>(y), place.side - 2), c = std::min(static_cast<int>(x), place.side - 2);
  const float b = y - static_cast<float>(r), a = x - static_cast<float>(c);
  const Post* south = place.posts + r * place.side + c;
  const Post* north = south + place.side;
  const float weights[4] = {(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b};
  const Post* corners[4] = {south, south + 1, north, north + 1};
  Post sum{};
  for (int i = 0; i < 4; ++i) {
    const float w = weights[i];
    const Post& p = *corners[i];
    sum.x += w * p.x, sum.y += w * p.y, sum.z += w * p.z, sum.fluence += w * p.fluence;
    sum.factor += w * p.factor, sum.earth += w * p.earth, sum.ground += w * p.ground;
  }
  return sum;
}

TerrainLight::Post TerrainLight::at_lane(const SurfacePoints& points, int lane) const {
  const TriangleId id = points.triangle[lane];
  const auto v = static_cast<float>(points.v[lane]), w = static_cast<float>(points.w[lane]);
  const auto r = static_cast<float>(id.r()), c = static_cast<float>(id.c());
  // dem::vertices_of(): v is the second vertex's weight, w the third's.
  return id.upper() ? between(id.block(), r + 1 - w, c + 1 - v) : between(id.block(), r + w, c + v);
}

void TerrainLight::add(const SurfacePoints& points, const Shading& shading, const Rays& rays, const Brdf& brdf,
                       const double* albedo, float* radiance) const {
  const bool hapke = request_.reflectance.model == ReflectanceModel::hapke;
  alignas(64) double mu0[kPacket], mu[kPacket], cos_phase[kPacket], light[kPacket], reflected[kPacket];
  alignas(64) double earth[kPacket], earth_mu0[kPacket], earth_phase[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    mu0[i] = earth_mu0[i] = 1e-9, mu[i] = shading.mu[i] > 0 ? shading.mu[i] : 0;
    cos_phase[i] = earth_phase[i] = light[i] = earth[i] = 0;
    if (!points.hit[i]) continue;
    const Post post = at_lane(points, i);
    const Vec3 normal = shading.normal(i), back = -rays.direction(i).normalized();
    const Vec3 from(static_cast<double>(post.x), static_cast<double>(post.y), static_cast<double>(post.z));
    const auto fluence = static_cast<double>(post.fluence);
    if (const double along = normal.dot(from); fluence > 0 && along > 0) {
      mu0[i] = std::min(along / fluence, 1.0), cos_phase[i] = back.dot(from) / fluence;
      light[i] = fluence * static_cast<double>(post.factor);
    }
    if (const double along = normal.dot(earth_); post.earth > 0 && along > 0)
      earth_mu0[i] = along, earth_phase[i] = back.dot(earth_), earth[i] = static_cast<double>(post.earth);
  }
  const auto take = [&](const double* amount) {
    for (int i = 0; i < kPacket; ++i)
      if (amount[i] > 0)
        radiance[i] += static_cast<float>(amount[i] * reflected[i] * (albedo && !hapke ? albedo[i] : 1));
  };
  brdf.times_mu0(mu0, mu, cos_phase, hapke ? albedo : nullptr, reflected);
  take(light);
  if (!(earth_w_m2_ > 0)) return;
  brdf.times_mu0(earth_mu0, mu, earth_phase, hapke ? albedo : nullptr, reflected);
  take(earth);
}

IndirectIrradiance TerrainLight::irradiance(const SurfacePoints& points, int lane, const Vec3& normal) const {
  const Post post = at_lane(points, lane);
  const Vec3 from(static_cast<double>(post.x), static_cast<double>(post.y), static_cast<double>(post.z));
  return {std::max(normal.dot(from), 0.0), static_cast<double>(post.earth) * std::max(normal.dot(earth_), 0.0)};
}

IndirectIrradiance TerrainLight::Place::on(const Vec3& normal) const {
  // Of level ground, a plane with that normal sees (1 - cos) / 2 of its hemisphere.
  return {std::max(normal.dot(terrain), 0.0) + ground * (1 - normal.dot(up)) / 2, std::max(normal.dot(earth), 0.0)};
}

TerrainLight::Place TerrainLight::at(const Vec3& place_m) const {
  Place out;
  const Geographic g = to_geographic(place_m);
  const dem::Ticks ticks = dem::ticks_of(g.lat_deg, g.lon_deg);
  out.up = place_m.normalized();
  const auto block = mesh_.block_at(ticks.whole_lat, ticks.whole_lon);
  if (!block) return out;
  const dem::BlockExtent& e = mesh_.blocks()[*block].posts->extent;
  const Post post = between(*block, static_cast<float>((ticks.lat - e.lat0) / e.lat_step),
                            static_cast<float>((ticks.lon - e.lon0) / e.lon_step));
  out.terrain = {static_cast<double>(post.x), static_cast<double>(post.y), static_cast<double>(post.z)};
  out.earth = static_cast<double>(post.earth) * earth_;
  out.ground = static_cast<double>(post.ground);
  return out;
}

}  // namespace selenograph::engine
