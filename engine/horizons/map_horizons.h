// Horizons of the pixels of a map, or of single places. Read first: find_map_horizons.
//
//   map --> tiles, one relief each --> packets of 4 x 4 pixels --> one march an azimuth --> on_packet
//           (halved until the relief fits)
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "dem/grid/map_grid.h"
#include "engine/cache/render_context.h"
#include "engine/relief/horizon_march.h"

namespace selenograph::engine {

// Horizons to find at each place. Azimuths are equally spaced, clockwise from north; at a pole north is the meridian 0,
// as in local_axes().
struct HorizonOptions {
  int azimuths = 720;
  double height_above_ground_m = 0;  // of the eye
  double farthest_m = 2e5;           // along the sphere; farther ground is ignored
};

// Horizons of up to sixteen neighbouring places.
struct PacketHorizons {
  // Index per lane: of a map's pixel, row by row, or of a place; -1: the lane has none, or it has no data.
  int index[kPacket];
  EastNorthUp axes[kPacket];  // at the lanes' places, MOON_ME
  double radius_m[kPacket];   // of the eyes, from the Moon's centre
  int azimuths;
  std::span<const float> elevation_deg;  // [azimuth * kPacket + lane]; NaN without data
};
// Called once for each packet with any data, from several threads at once.
using OnPacketHorizons = std::function<void(const PacketHorizons&)>;
// Called with the share of pixels that are done.
using HorizonProgress = std::function<void(double)>;

struct HorizonReport {
  std::size_t missing_places = 0;  // without data
  double min_spacing_m = 0;        // smallest spacing of a relief's finest grid
};

// Finds the horizons of a map's pixels. Throws Cancelled, DataError, and ImpossibleRequest for a map whose reliefs do
// not fit into memory.
HorizonReport find_map_horizons(const dem::MapGrid& grid, const HorizonOptions& options, const RenderContext& context,
                                const OnPacketHorizons& on_packet, const HorizonProgress& progress = {});
// Finds the horizons of places, unit vectors from the Moon's centre. Places within 2 km of each other share a relief.
HorizonReport find_place_horizons(std::span<const Vec3> places, const HorizonOptions& options,
                                  const RenderContext& context, const OnPacketHorizons& on_packet,
                                  const HorizonProgress& progress = {});

// Horizons of a map's pixels, row by row, or of places: elevation_deg[azimuth * eyes + eye]; NaN without data.
struct HorizonElevations {
  std::vector<float> elevation_deg;
  HorizonReport report;
};
HorizonElevations map_horizons(const dem::MapGrid& grid, const HorizonOptions& options, const RenderContext& context,
                               const HorizonProgress& progress = {});
HorizonElevations place_horizons(std::span<const Vec3> places, const HorizonOptions& options,
                                 const RenderContext& context, const HorizonProgress& progress = {});

}  // namespace selenograph::engine
