#include "engine/horizons/map_horizons.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>
#include <string_view>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/terrain/surface_place.h"
#include "engine/relief/horizon_plan.h"
#include "engine/relief/terrain_heights.h"

namespace selenograph::engine {
namespace {

// Returns the error for a place whose terrain exceeds the memory for it.
ImpossibleRequest too_large(std::string_view eye) {
  return ImpossibleRequest(fmt::format("the terrain around one {} does not fit into memory: reduce farthest_km", eye),
                           "farthest_km");
}

constexpr int kPacketColumns = 4;  // and rows, of pixels in a packet

// Sixteen places that march together. Lanes with index -1 have none.
struct PlacePacket {
  std::array<int, kPacket> index;
  std::array<Vec3, kPacket> up;  // unit vectors
  int column = 0, row = 0;       // of a map's pixel in lane 0
};

// Pixels of a map that are a square lattice on the gnomonic plane around one of them.
struct PixelLattice {
  int column, row;  // of the pixel in the middle
  double spacing_m;
  double turn_rad;  // of the map's rows from east in the middle, counter-clockwise
};

// Places that share a relief: those of a rectangle of the map, or a group of single places.
struct PlaceTile {
  std::vector<PlacePacket> packets;
  std::vector<std::size_t> group_begins{0};  // first packet of each group of neighbours, and the number of packets
  Vec3 centre = Vec3::zero();
  double half_m = 0;  // half the side of the square that holds all places, on the gnomonic plane around the centre
  std::size_t places = 0;
  std::optional<PixelLattice> lattice;
};

// Sets the centre and the size of a tile. Returns false if it has no places or is too wide for a plane.
bool enclose(PlaceTile& tile) {
  Vec3 sum = Vec3::zero();
  for (const PlacePacket& packet : tile.packets)
    for (std::size_t i = 0; i < kPacket; ++i)
      if (packet.index[i] >= 0) sum += packet.up[i];
  if (!(sum.norm() > 1e-3)) return false;
  tile.centre = sum.normalized();
  const Mat3 axes = relief_axes(tile.centre);
  for (const PlacePacket& packet : tile.packets)
    for (std::size_t i = 0; i < kPacket; ++i) {
      if (packet.index[i] < 0) continue;
      const Vec3 local = axes * packet.up[i];
      constexpr double kMinCosine = 0.9;
      if (local.z() < kMinCosine) return false;
      tile.half_m = std::max({tile.half_m, kMoonRadius_m * std::abs(local.x() / local.z()),
                              kMoonRadius_m * std::abs(local.y() / local.z())});
    }
  return true;
}

// Returns the spacing of the finest posts around a tile, m.
double finest_spacing_m(const PlaceTile& tile, const dem::Terrain& terrain) {
  const Mat3 axes = relief_axes(tile.centre);
  constexpr int kSamples = 4;              // on each side of the centre
  constexpr double kSurroundings_m = 500;  // posts of finer ground farther away are read at the tile's spacing
  const double step_m = (tile.half_m + kSurroundings_m) / kSamples;
  int finest = 0;
  for (int row = -kSamples; row <= kSamples; ++row)
    for (int column = -kSamples; column <= kSamples; ++column) {
      const Vec3 d = axes.transpose_times(Vec3(column * step_m, row * step_m, kMoonRadius_m).normalized());
      const Geographic position = to_geographic(d * kMoonRadius_m);
      const dem::Ticks ticks = dem::ticks_of(position.lat_deg, position.lon_deg);
      const dem::BlockId id = dem::block_at(dem::kMaxLevel, ticks.whole_lat, ticks.whole_lon);
      if (terrain.has_data(id)) finest = std::max(finest, terrain.posts_level(id));
    }
  return dem::post_spacing_m(finest);
}

// Marches tile by tile, and reports what is done.
class HorizonSearch {
 public:
  HorizonSearch(const HorizonOptions& options, const RenderContext& context, const OnPacketHorizons& on_packet,
                const HorizonProgress& progress, std::size_t places)
      : options_(options), context_(context), on_packet_(on_packet), progress_(progress), place_count_(places) {
    report_.min_spacing_m = std::numeric_limits<double>::infinity();
  }

  // Returns the shape of a tile's relief. Its finest spacing is an eighth of the posts', because its cells round the
  // edges of triangles and so lower crests. On a lattice it is about that, so that it divides the lattice's spacing.
  ReliefShape shape_of(const PlaceTile& tile) const {
    const double spacing_m = finest_spacing_m(tile, context_.terrain) / 8;
    constexpr double kCoarser_log2 = 0.15;
    const double posts_log2 = tile.lattice ? std::log2(tile.lattice->spacing_m / spacing_m) : -1;
    ReliefShape shape{.centre = tile.centre,
                      .half_m = tile.half_m,
                      .spacing_m = spacing_m,
                      .farthest_m = options_.farthest_m,
                      .posts_per_distance = kHorizonPostsPerDistance,
                      .void_height_m = kVoidHeight_m};
    if (!tile.lattice || posts_log2 < -kCoarser_log2) return shape;
    shape.lattice_log2 = static_cast<int>(std::ceil(posts_log2 - kCoarser_log2));
    shape.half_m += (kPacketColumns - 1) * tile.lattice->spacing_m;  // packets may exceed the tile
    shape.spacing_m = std::ldexp(tile.lattice->spacing_m, -shape.lattice_log2);
    shape.turn_rad = tile.lattice->turn_rad;
    return shape;
  }
  const dem::Terrain& terrain() const { return context_.terrain; }
  static bool fits(const ReliefShape& shape) {
    constexpr double kMaxPosts = 6e7;  // with their tables, 0.6 GB
    return post_count(shape) <= kMaxPosts;
  }

  void find(const PlaceTile& tile, const ReliefShape& shape) {
    const Relief relief(shape, heights_of(context_.terrain, context_.stop), context_.stop);
    const MarchPlan plan = plan_marches(relief, context_.stop);
    report_.min_spacing_m = std::min(report_.min_spacing_m, shape.spacing_m);
    in_parallel(tile.group_begins.size() - 1, [&](std::size_t i) {
      context_.stop.check();
      const std::size_t first = tile.group_begins[i], past_last = tile.group_begins[i + 1];
      find(std::span(tile.packets).subspan(first, past_last - first), relief, plan,
           shape.lattice_log2 < 0 ? nullptr : &*tile.lattice);
    });
  }

  // Counts places as done.
  void done(std::size_t places) {
    const std::lock_guard lock(mutex_);
    done_ += places;
    if (progress_) progress_(static_cast<double>(done_) / static_cast<double>(place_count_));
  }

  HorizonReport report() const {
    HorizonReport report = report_;
    report.missing_places = missing_;
    if (!std::isfinite(report.min_spacing_m)) report.min_spacing_m = 0;
    return report;
  }

 private:
  // Sets a lane's position, unless it is on the lattice, and directions in the relief's plane. Its eye stands over
  // triangle_m, the ground's height above the datum, or over the relief where that is higher. Returns false without
  // data.
  bool place_lane(const Vec3& up, double triangle_m, const Relief& relief, std::size_t lane, MarchPlaces& march,
                  PacketHorizons& out) const {
    out.axes[lane] = local_axes(up);
    const Vec3 p = relief.axes() * up;
    if (!march.on_lattice) {
      march.x[lane] = static_cast<float>(kMoonRadius_m * p.x() / p.z());
      march.y[lane] = static_cast<float>(kMoonRadius_m * p.y() / p.z());
    }
    // A step of tan(a) along the unit tangent t leads to (p + tan(a) t) / (p.z + tan(a) t.z) on the plane.
    const auto set = [&](const Vec3& direction, float* x, float* y, float* k) {
      const Vec3 t = relief.axes() * direction;
      x[lane] = static_cast<float>((t.x() - p.x() / p.z() * t.z()) / p.z());
      y[lane] = static_cast<float>((t.y() - p.y() / p.z() * t.z()) / p.z());
      k[lane] = static_cast<float>(t.z() / p.z());
    };
    set(out.axes[lane].north, march.north_x, march.north_y, march.north_k);
    set(out.axes[lane].east, march.east_x, march.east_y, march.east_k);
    const std::optional<double> ground_m =
        relief.height_m(static_cast<double>(march.x[lane]), static_cast<double>(march.y[lane]));
    // fmax() ignores a NaN.
    const double eye_m =
        std::fmax(ground_m.value_or(relief.reference_m()), triangle_m) + options_.height_above_ground_m;
    march.height[lane] = static_cast<float>(eye_m - relief.reference_m());
    out.radius_m[lane] = kMoonRadius_m + eye_m;
    return ground_m.has_value();
  }

  // Sets the lanes of a packet. Returns the number of its places that have data.
  std::size_t place_packet(const PlacePacket& packet, const Relief& relief, const PixelLattice* lattice,
                           MarchPlaces& march, PacketHorizons& out) const {
    march.on_ground = options_.height_above_ground_m == 0;
    march.on_lattice = lattice != nullptr;
    for (int i = 0; lattice && i < kPacket; ++i) {
      march.x[i] = static_cast<float>((packet.column + i % kPacketColumns - lattice->column) * lattice->spacing_m);
      const int row = packet.row + i / kPacketColumns;
      march.y[i] = static_cast<float>((lattice->row - row) * lattice->spacing_m);
    }
    // Lanes without a place repeat the first one, so that they do not widen the packet.
    const auto first = static_cast<std::size_t>(
        std::find_if(packet.index.begin(), packet.index.end(), [](int i) { return i >= 0; }) - packet.index.begin());
    std::array<Vec3, kPacket> up;
    for (std::size_t i = 0; i < kPacket; ++i) up[i] = packet.up[packet.index[i] >= 0 ? i : first];
    // The relief's cells round crests between triangles, and an eye on a rounded crest finds its horizon too high.
    // Pixels of a lattice stand on posts, where both agree. An eye on the ground stays on the relief: it would be below
    // or above the ground that it looks along.
    std::array<float, kPacket> triangle_m;
    triangle_m.fill(std::numeric_limits<float>::quiet_NaN());
    if (!march.on_lattice && !march.on_ground)
      heights_of(context_.terrain, context_.stop)(relief.shape().spacing_m, up, triangle_m);
    std::size_t with_data = 0;
    for (std::size_t i = 0; i < kPacket; ++i) {
      const bool has_data = place_lane(up[i], static_cast<double>(triangle_m[i]), relief, i, march, out);
      march.valid[i] = packet.index[i] >= 0 && has_data;
      out.index[i] = march.valid[i] ? packet.index[i] : -1;
      with_data += march.valid[i];
    }
    for (std::size_t i = 0; i < kPacket; ++i) {
      march.spread_m = std::max({march.spread_m, std::abs(march.x[i] - march.x[0]), std::abs(march.y[i] - march.y[0])});
      const float turn = std::hypot(march.north_x[i] - march.north_x[0], march.north_y[i] - march.north_y[0]);
      march.turn = std::max(march.turn, turn);
    }
    return with_data;
  }

  // Finds the horizons of a group of neighbouring packets.
  void find(std::span<const PlacePacket> packets, const Relief& relief, const MarchPlan& plan,
            const PixelLattice* lattice) {
    std::vector<MarchPlaces> marches;
    std::vector<PacketHorizons> out;
    std::size_t places = 0, with_data = 0;
    for (const PlacePacket& packet : packets) {
      places += static_cast<std::size_t>(
          std::count_if(packet.index.begin(), packet.index.end(), [](int i) { return i >= 0; }));
      const std::size_t found = place_packet(packet, relief, lattice, marches.emplace_back(), out.emplace_back());
      with_data += found;
      if (found > 0) continue;
      marches.pop_back();
      out.pop_back();
    }
    missing_ += places - with_data;
    const std::size_t packet_elements = static_cast<std::size_t>(options_.azimuths) * kPacket;
    std::vector<float> elevation_deg(marches.size() * packet_elements);
    find_horizons(plan, marches, options_.azimuths, elevation_deg.data());
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i].azimuths = options_.azimuths;
      out[i].elevation_deg = std::span(elevation_deg).subspan(i * packet_elements, packet_elements);
      on_packet_(out[i]);
    }
    done(places);
  }

  const HorizonOptions& options_;
  const RenderContext& context_;
  const OnPacketHorizons& on_packet_;
  const HorizonProgress& progress_;
  std::size_t place_count_, done_ = 0;
  std::atomic<std::size_t> missing_{0};
  std::mutex mutex_;
  HorizonReport report_;
};

// A rectangle of the map's pixels.
struct PixelRect {
  int x, y, width, height;
};

// Appends a packet of 4 x 4 pixels from a position on, if any of them is in the rectangle and on the Moon.
void add_packet(const dem::MapGrid& grid, const dem::MapTransform& map, const PixelRect& rect, int x, int y,
                PlaceTile& tile) {
  PlacePacket packet;
  packet.index.fill(-1);
  packet.column = x;
  packet.row = y;
  std::size_t places = 0;
  for (int i = 0; i < kPacket; ++i) {
    const int column = x + i % kPacketColumns, row = y + i / kPacketColumns;
    if (column >= rect.x + rect.width || row >= rect.y + rect.height) continue;
    const std::optional<Vec3> up = map.direction(grid.point(column, row));
    if (!up) continue;
    const auto lane = static_cast<std::size_t>(i);
    packet.index[lane] = row * grid.width + column;
    packet.up[lane] = *up;
    ++places;
  }
  if (places > 0) tile.packets.push_back(packet);
  tile.places += places;
}

// Returns a rectangle as groups of packets, each group a square of kGroup_px x kGroup_px pixels.
PlaceTile tile_of(const dem::MapGrid& grid, const PixelRect& rect) {
  constexpr int kGroup_px = 32;
  const dem::MapTransform map(grid.plane);
  PlaceTile tile;
  for (int y = rect.y; y < rect.y + rect.height; y += kGroup_px)
    for (int x = rect.x; x < rect.x + rect.width; x += kGroup_px) {
      for (int row = y; row < std::min(y + kGroup_px, rect.y + rect.height); row += kPacketColumns)
        for (int column = x; column < std::min(x + kGroup_px, rect.x + rect.width); column += kPacketColumns)
          add_packet(grid, map, rect, column, row, tile);
      tile.group_begins.push_back(tile.packets.size());
    }
  return tile;
}

// Returns the lattice of a rectangle's pixels; empty if the projection moves any of them from it by more than
// max_shift_m.
std::optional<PixelLattice> lattice_of(const dem::MapGrid& grid, const PixelRect& rect, double max_shift_m) {
  const dem::MapTransform map(grid.plane);
  PixelLattice lattice{rect.x + rect.width / 2, rect.y + rect.height / 2, 0, 0};
  const std::optional<Vec3> centre = map.direction(grid.point(lattice.column, lattice.row));
  if (!centre) return std::nullopt;
  const Mat3 axes = relief_axes(*centre);
  // Returns the position in the plane of a pixel by its distance from the middle; NaN beyond the Moon's limb.
  const auto position = [&](int columns, int rows) -> Vec2 {
    const std::optional<Vec3> up = map.direction(grid.point(lattice.column + columns, lattice.row + rows));
    const Vec3 p = up ? axes * *up : Vec3(std::nan(""), 0, 0);
    return kMoonRadius_m / p.z() * p.xy();
  };
  const int half = std::max(1, std::max(rect.width, rect.height) / 2);
  const Vec2 step = (position(half, 0) - position(-half, 0)) / (2 * half);
  lattice.spacing_m = step.norm();
  lattice.turn_rad = std::atan2(step.y(), step.x());
  for (const int rows : {-half, 0, half})
    for (const int columns : {-half, 0, half}) {
      const Vec2 node = columns * step + rows * Vec2(step.y(), -step.x());
      if (!((position(columns, rows) - node).norm() <= max_shift_m)) return std::nullopt;
    }
  return lattice;
}

// Places the centre of a tile in the middle of its lattice.
void centre_on_lattice(const dem::MapGrid& grid, const PixelRect& rect, PlaceTile& tile) {
  tile.centre = *dem::MapTransform(grid.plane).direction(grid.point(tile.lattice->column, tile.lattice->row));
  const int half = std::max(rect.width, rect.height) / 2 + 1;
  tile.half_m = half * tile.lattice->spacing_m;
}

// Finds the horizons of a rectangle, or of its halves if its relief would be too large.
void find(const dem::MapGrid& grid, const PixelRect& rect, HorizonSearch& search) {
  PlaceTile tile = tile_of(grid, rect);
  const auto pixels = static_cast<std::size_t>(rect.width) * static_cast<std::size_t>(rect.height);
  if (tile.places == 0) return search.done(pixels);
  if (enclose(tile)) {
    // Pixels may stand aside by a small share of the spacing of posts.
    tile.lattice = lattice_of(grid, rect, finest_spacing_m(tile, search.terrain()) / 32);
    if (tile.lattice) centre_on_lattice(grid, rect, tile);
    if (const ReliefShape shape = search.shape_of(tile); HorizonSearch::fits(shape)) {
      search.find(tile, shape);
      return search.done(pixels - tile.places);
    }
  }
  if (pixels == 1) throw too_large("pixel");
  PixelRect a = rect, b = rect;
  // Halve to a multiple of four pixels where possible, so that packets stay full.
  const auto half = [](int side) { return side > 8 ? (side / 2 + 3) / 4 * 4 : (side + 1) / 2; };
  if (rect.width >= rect.height) {
    a.width = half(rect.width);
    b.x += a.width;
    b.width -= a.width;
  } else {
    a.height = half(rect.height);
    b.y += a.height;
    b.height -= a.height;
  }
  find(grid, a, search);
  find(grid, b, search);
}

// Returns groups of places within 2 km of the first one of each, as their indices.
std::vector<std::vector<std::size_t>> groups_of(std::span<const Vec3> places) {
  constexpr double kGroup_m = 2000;
  std::vector<std::vector<std::size_t>> groups;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const auto near = std::find_if(groups.begin(), groups.end(), [&](const std::vector<std::size_t>& group) {
      return angle_between(places[group.front()], places[i]) * kMoonRadius_m < kGroup_m;
    });
    if (near == groups.end())
      groups.push_back({i});
    else
      near->push_back(i);
  }
  return groups;
}

// Finds the horizons of a group of places, or of its halves if its relief would be too large.
void find(std::span<const Vec3> places, std::span<const std::size_t> group, HorizonSearch& search) {
  PlaceTile tile;
  tile.places = group.size();
  for (std::size_t i = 0; i < group.size(); ++i) {
    if (i % kPacket == 0) {
      tile.packets.emplace_back();
      tile.packets.back().index.fill(-1);
    }
    tile.packets.back().index[i % kPacket] = static_cast<int>(group[i]);
    tile.packets.back().up[i % kPacket] = places[group[i]];
  }
  tile.group_begins.push_back(tile.packets.size());
  enclose(tile);
  const ReliefShape shape = search.shape_of(tile);
  if (HorizonSearch::fits(shape)) return search.find(tile, shape);
  if (group.size() == 1) throw too_large("place");
  find(places, group.first(group.size() / 2), search);
  find(places, group.subspan(group.size() / 2), search);
}

}  // namespace

HorizonReport find_map_horizons(const dem::MapGrid& grid, const HorizonOptions& options, const RenderContext& context,
                                const OnPacketHorizons& on_packet, const HorizonProgress& progress) {
  const std::size_t pixels = static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height);
  HorizonSearch search(options, context, on_packet, progress, pixels);
  constexpr int kLargestTile_px = 512;
  for (int y = 0; y < grid.height; y += kLargestTile_px)
    for (int x = 0; x < grid.width; x += kLargestTile_px)
      find(grid, {x, y, std::min(kLargestTile_px, grid.width - x), std::min(kLargestTile_px, grid.height - y)}, search);
  return search.report();
}

HorizonReport find_place_horizons(std::span<const Vec3> places, const HorizonOptions& options,
                                  const RenderContext& context, const OnPacketHorizons& on_packet,
                                  const HorizonProgress& progress) {
  HorizonSearch search(options, context, on_packet, progress, places.size());
  for (const std::vector<std::size_t>& group : groups_of(places)) find(places, group, search);
  return search.report();
}

namespace {

// Stores the horizons that find(on_packet) finds for a number of eyes.
template <typename Find>
HorizonElevations store_horizons(std::size_t eyes, const HorizonOptions& options, const Find& find) {
  HorizonElevations out;
  out.elevation_deg.assign(static_cast<std::size_t>(options.azimuths) * eyes, std::numeric_limits<float>::quiet_NaN());
  out.report = find([&](const PacketHorizons& packet) {
    for (std::size_t lane = 0; lane < kPacket; ++lane) {
      if (packet.index[lane] < 0) continue;
      float* eye = &out.elevation_deg[static_cast<std::size_t>(packet.index[lane])];
      for (std::size_t a = 0; a < static_cast<std::size_t>(packet.azimuths); ++a)
        eye[a * eyes] = packet.elevation_deg[a * kPacket + lane];
    }
  });
  return out;
}

}  // namespace

HorizonElevations map_horizons(const dem::MapGrid& grid, const HorizonOptions& options, const RenderContext& context,
                               const HorizonProgress& progress) {
  const std::size_t pixels = static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height);
  return store_horizons(pixels, options, [&](const OnPacketHorizons& store) {
    return find_map_horizons(grid, options, context, store, progress);
  });
}

HorizonElevations place_horizons(std::span<const Vec3> places, const HorizonOptions& options,
                                 const RenderContext& context, const HorizonProgress& progress) {
  return store_horizons(places.size(), options, [&](const OnPacketHorizons& store) {
    return find_place_horizons(places, options, context, store, progress);
  });
}

}  // namespace selenograph::engine
