#include "engine/rays/light_at_places.h"

#include <algorithm>
#include <cstdint>
#include <map>

#include "dem/grid/lattice.h"
#include "dem/terrain/surface_place.h"
#include "engine/cache/render_context.h"
#include "engine/radiometry/radiometry.h"

namespace selenograph::engine {
namespace {

// Returns the field whose posts are as close as the terrain's own at a position.
LightField field_at(const Vec3& position_m, const dem::Terrain& terrain) {
  const Geographic g = to_geographic(position_m);
  const int level = terrain.posts_level(dem::block_at_place(dem::kMaxLevel, g.lat_deg, g.lon_deg));
  return light_field_at(level, level, false, g.lat_deg, g.lon_deg);
}

struct PlaceInField {
  std::size_t index;
  FieldPost post;
};

}  // namespace

std::vector<Irradiance> light_at_places(std::span<const LitPlace> places, const FrameRequest& request,
                                        const RenderContext& context) {
  const double direct_w_m2 = radiance_terms(request).direct_w_m2;
  const LightSources sources = light_sources(request, direct_w_m2);
  std::vector<Irradiance> out(places.size());
  std::map<LightField, std::vector<PlaceInField>> fields;
  for (std::size_t i = 0; i < places.size(); ++i) {
    out[i].direct_w_m2 = direct_w_m2 * places[i].incident;
    fields[field_at(places[i].position_m, context.terrain)].push_back({i, {}});
  }
  for (auto& [field, places_in_field] : fields) {
    context.stop.check();
    const FieldPlane plane(field);
    // Per tile, bit r: row r of its posts is needed. A place lies between rows post.row and post.row + 1.
    std::map<int, std::uint16_t> rows;
    for (PlaceInField& p : places_in_field) {
      p.post = plane.post_at(places[p.index].position_m);
      rows[p.post.tile] |= static_cast<std::uint16_t>(3U << p.post.row);
    }
    std::vector<TileRows> tile_rows;
    tile_rows.reserve(rows.size());
    for (const auto& [tile, rows_of_tile] : rows) tile_rows.push_back({tile, rows_of_tile});
    const auto light_tiles = context.cache.light_tiles().get(
        field, plane, tile_rows, {context.terrain, request, tile_rows.size()}, context.stop);
    for (const PlaceInField& p : places_in_field) {
      const auto tile_index =
          std::lower_bound(tile_rows.begin(), tile_rows.end(), p.post.tile,
                           [](const TileRows& rows_of_tile, int number) { return rows_of_tile.tile < number; }) -
          tile_rows.begin();
      const std::size_t south_west = LightTile::first_of(p.post.row) + static_cast<std::size_t>(p.post.column);
      const LightTile& light = *light_tiles[static_cast<std::size_t>(tile_index)];
      const Irradiance indirect =
          irradiance_at({&light.posts[south_west], static_cast<float>(p.post.east), static_cast<float>(p.post.north)},
                        places[p.index].normal, sources);
      out[p.index].terrain_w_m2 = indirect.terrain_w_m2;
      out[p.index].earth_w_m2 = indirect.earth_w_m2;
    }
  }
  return out;
}

}  // namespace selenograph::engine
