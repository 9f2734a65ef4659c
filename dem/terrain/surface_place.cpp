#include "dem/terrain/surface_place.h"

#include <algorithm>
#include <cmath>

#include "dem/grid/surface.h"

namespace selenograph::dem {

Ticks ticks_of(double lat_deg, double lon_deg) {
  const double lat = std::clamp((lat_deg + 90) * kTicksPerDegree, 0.0, kLatTicks - 1.0),
               turned = (wrap_lon_deg(lon_deg) + 180) * kTicksPerDegree,
               lon = turned < kLonTicks ? turned : 0;  // rounding may turn a longitude just below 180 into 180
  return {lat, lon, static_cast<Tick>(lat), static_cast<Tick>(lon)};
}

BlockId block_at_place(int level, double lat_deg, double lon_deg) { return ticks_of(lat_deg, lon_deg).block(level); }

int finest_level_at(const Terrain& terrain, double lat_deg, double lon_deg) {
  return terrain.finest_level(ticks_of(lat_deg, lon_deg).block(kMaxLevel));
}

std::optional<SurfacePlace> surface_at(const Terrain& terrain, double lat_deg, double lon_deg, int level,
                                       const StopToken& stop) {
  const Ticks at = ticks_of(lat_deg, lon_deg);
  const auto block = terrain.block(at.block(std::min(level, terrain.finest_level(at.block(kMaxLevel)))), stop);
  return block ? surface_on(*block, lat_deg, lon_deg) : std::nullopt;
}

// Intersects the radial ray at the position with the two triangles of its quad.
std::optional<SurfacePlace> surface_on(const Block& block, double lat_deg, double lon_deg) {
  const Ticks at = ticks_of(lat_deg, lon_deg);
  const BlockExtent& e = block.extent;
  const double y = (at.lat - e.lat0) / e.lat_step, x = (at.lon - e.lon0) / e.lon_step;  // in posts of the block
  const int r = std::clamp(static_cast<int>(y), 0, e.quads - 1), c = std::clamp(static_cast<int>(x), 0, e.quads - 1);
  const Vec3 direction = to_cartesian({lat_deg, lon_deg, 0}).normalized();
  // Repeat with more slack: the triangles' edges are great circles, not parallels, so that a position beside an edge
  // may lie slightly outside both triangles.
  for (const double slack : {1e-9, 1e-3})
    for (const bool upper : {false, true}) {
      const QuadVertices q = vertices_of(r, c, upper);
      const auto vertex = [&](int i) {
        const float height_m = block.vertices[block.index(q.r[i], q.c[i])].height_m;
        return block.position(q.r[i], q.c[i], static_cast<double>(height_m));
      };
      const Triangle t{vertex(0), vertex(1), vertex(2)};
      const auto distance = radial_distance(t, direction, slack);
      if (!distance || std::isnan(*distance)) continue;
      return SurfacePlace{*distance - kMoonRadius_m, (t.b - t.a).cross(t.c - t.a).normalized()};
    }
  return std::nullopt;
}

}  // namespace selenograph::dem
