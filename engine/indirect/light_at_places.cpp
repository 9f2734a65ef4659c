#include "engine/indirect/light_at_places.h"

#include <algorithm>
#include <cstdint>
#include <map>

#include "dem/grid/lattice.h"
#include "dem/terrain/surface_place.h"
#include "engine/radiometry/radiometry.h"

namespace selenograph::engine {
namespace {

LightField field_at(const Vec3& position_m, const dem::Terrain& terrain) {
  const Geographic g = to_geographic(position_m);
  const int level = terrain.posts_level(dem::block_at_place(dem::kMaxLevel, g.lat_deg, g.lon_deg));
  return light_field_at(level, level, false, g.lat_deg, g.lon_deg);
}

struct PlaceInField {
  std::size_t place;
  FieldPost post;
};

}  // namespace

std::vector<Irradiance> light_at_places(std::span<const LitPlace> places, const FrameRequest& request,
                                        const dem::Terrain& terrain, LightTiles& tiles, const StopToken& stop) {
  const double direct_w_m2 = radiance_terms(request).direct_w_m2;
  const LightSources sources = light_sources(request, direct_w_m2);
  std::vector<Irradiance> out(places.size());
  std::map<LightField, std::vector<PlaceInField>> fields;
  for (std::size_t i = 0; i < places.size(); ++i) {
    out[i].direct_w_m2 = direct_w_m2 * places[i].incident;
    fields[field_at(places[i].position_m, terrain)].push_back({i, {}});
  }
  for (auto& [field, in_it] : fields) {
    stop.check();
    const FieldPlane plane(field);
    std::map<int, std::uint16_t> rows;  // of tiles
    for (PlaceInField& p : in_it) {
      p.post = plane.post_at(places[p.place].position_m);
      rows[p.post.tile] |= static_cast<std::uint16_t>(3U << p.post.row);
    }
    std::vector<TileRows> wanted;
    wanted.reserve(rows.size());
    for (const auto& [tile, of_tile] : rows) wanted.push_back({tile, of_tile});
    const auto made = tiles.get(field, plane, wanted, {terrain, request}, stop);
    for (const PlaceInField& p : in_it) {
      const auto tile = std::lower_bound(wanted.begin(), wanted.end(), p.post.tile,
                                         [](const TileRows& of, int number) { return of.tile < number; }) -
                        wanted.begin();
      const std::size_t at = LightTile::first_of(p.post.row) + static_cast<std::size_t>(p.post.column);
      const LightTile& light = *made[static_cast<std::size_t>(tile)];
      const Irradiance indirect =
          irradiance_at({&light.posts[at], static_cast<float>(p.post.east), static_cast<float>(p.post.north)},
                        places[p.place].normal, sources);
      out[p.place].terrain_w_m2 = indirect.terrain_w_m2;
      out[p.place].earth_w_m2 = indirect.earth_w_m2;
    }
  }
  return out;
}

}  // namespace selenograph::engine
