#include "engine/visibility/objects/rocks_near_rays.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <iterator>

#include "dem/base/parallel.h"
#include "dem/detail/footprints.h"
#include "dem/grid/geodesy.h"
#include "engine/frame/needs.h"
#include "engine/scene/node_bounds.h"
#include "engine/visibility/objects/rocks_in_view.h"

namespace selenograph::engine {
namespace {

// Number of rays through a block above which all of its rocks are searched at once.
constexpr std::size_t kMaxRaysSearchedSingly = 16;
constexpr double kSectionDiameters = 4;  // length of the sections of a ray that are searched at once, in diameters

// An interval of distances along a ray.
struct RayInterval {
  double from_m, to_m;
};

// Returns the distance along the line of a ray at which it is nearest to the centre of the Moon.
double closest_to_centre_m(const RayCone& ray) { return -ray.origin_m.dot(ray.direction); }

// Returns the square of the distance, m, along the ray from closest_to_centre_m() to where it is at a height; negative
// if it never is.
double half_chord2(const RayCone& ray, double height_m) {
  const double radius_m = kMoonRadius_m + height_m;
  const double closest_m = closest_to_centre_m(ray);
  return radius_m * radius_m - (ray.origin_m + closest_m * ray.direction).squared_norm();
}

// Returns the interval of a ray inside the ball around a block in which it is at most `above_m` above the terrain of
// the block; both are enlarged by above_m.
std::optional<RayInterval> interval_over(const RayCone& ray, const NodeBounds& b, double above_m) {
  // Intersect the chord through the ball with the one through a sphere above the terrain, which has a margin of 1 m.
  const Vec3 to = b.centre - ray.origin_m;
  const double along_m = to.dot(ray.direction);
  const double reach_m = b.radius_m + above_m;
  const double ball_half_chord2 = reach_m * reach_m - (to - along_m * ray.direction).squared_norm();
  const double height_half_chord2 = half_chord2(ray, b.high_m + b.bulge_m + 1 + above_m);
  if (ball_half_chord2 < 0 || height_half_chord2 < 0) return std::nullopt;
  const RayInterval interval{
      std::max({0.0, along_m - std::sqrt(ball_half_chord2), closest_to_centre_m(ray) - std::sqrt(height_half_chord2)}),
      std::min(along_m + std::sqrt(ball_half_chord2), closest_to_centre_m(ray) + std::sqrt(height_half_chord2))};
  return interval.from_m <= interval.to_m ? std::optional(interval) : std::nullopt;
}

// Ends an interval where the ray passes below a height for good.
RayInterval clip_below(const RayCone& ray, RayInterval interval, double height_m) {
  if (const double below = half_chord2(ray, height_m); below > 0)
    if (const double enters = closest_to_centre_m(ray) - std::sqrt(below); enters >= interval.from_m)
      interval.to_m = std::min(interval.to_m, enters);
  return interval;
}

// Cuts an interval into sections of at most `longest_m`: the box around a slanting section is as wide as the section is
// long.
std::vector<RayInterval> sections_of(const RayInterval& interval, double longest_m) {
  std::vector<RayInterval> sections;
  const double length_m = interval.to_m - interval.from_m;
  const int count = static_cast<int>(std::max(1.0, std::ceil(length_m / longest_m)));
  const auto section_end_m = [&](int i) { return interval.from_m + static_cast<double>(i) / count * length_m; };
  sections.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) sections.push_back({section_end_m(i), section_end_m(i + 1)});
  return sections;
}

// Returns the footprint of an interval with a margin; empty near a pole, where a box in degrees would be large.
std::optional<dem::Footprint> footprint_below(const RayCone& ray, const RayInterval& interval, double margin_m) {
  const Vec3 from = ray.origin_m + interval.from_m * ray.direction, to = ray.origin_m + interval.to_m * ray.direction;
  const Geographic a = to_geographic(from), b = to_geographic(to);
  const double length_m = interval.to_m - interval.from_m;
  const double to_axis_m = std::hypot(from.x(), from.y());
  if (to_axis_m < 20 * (length_m + margin_m)) return std::nullopt;
  double west = a.lon_deg, east = b.lon_deg;
  if (west > east) std::swap(west, east);
  if (east - west > 180) {
    std::swap(west, east);
    east += 360;
  }
  // A straight line leaves the box of its ends by at most this bend.
  const double bend_m = length_m * length_m / to_axis_m;
  return dem::around({std::min(a.lat_deg, b.lat_deg), std::max(a.lat_deg, b.lat_deg), west, east}, margin_m + bend_m);
}

}  // namespace

// Returns the regions to search for rocks larger than `omitted_m`, octave by octave: strips of ground below the
// sections of few single rays, whole blocks otherwise. Empty if more than kMaxRocksOfRays rocks are expected in them.
std::optional<RocksNearRays::SearchRegions> RocksNearRays::regions_along(std::span<const RayCone> rays,
                                                                         std::span<const BlockOnRays> blocks,
                                                                         double omitted_m,
                                                                         const StopToken& stop) const {
  constexpr std::size_t kMaxStrips = std::size_t{1} << 19;  // 20 MB; with more strips, blocks are searched instead
  const dem::RockField& field = survey_.field();
  SearchRegions regions;
  double expected = 0;
  for (const BlockOnRays& block : blocks) {
    const auto add_block = [&](int octave) {
      regions.octave_blocks.emplace_back(octave,
                                         ancestor_of(block.id, std::min(block.id.level, level_of_rocks(octave))));
    };
    const NodeBounds bounds = bounds_of(block.id, block.low_m, block.high_m);
    const bool has_cones =
        !std::all_of(block.rays.begin(), block.rays.end(), [&](std::size_t i) { return rays[i].is_single_ray(); });
    const dem::Footprint footprint = dem::footprint_of(block.id);
    for (int octave = field.smallest_octave(); octave <= field.largest_octave() && expected <= kMaxRocksOfRays;
         ++octave) {
      if (field.largest_m(octave) <= omitted_m) continue;
      if (has_cones || block.rays.size() > kMaxRaysSearchedSingly || regions.strips.size() > kMaxStrips) {
        add_block(octave);
        continue;
      }
      const dem::Footprint padded_footprint = dem::around(footprint, field.largest_m(octave));
      for (const std::size_t i : block.rays) {
        stop.check();
        const auto interval = interval_over(rays[i], bounds, field.largest_m(octave));
        if (!interval) continue;
        const double lowest_m = bounds.low_m - bounds.bulge_m - 1 - field.largest_m(octave);
        for (const RayInterval& section :
             sections_of(clip_below(rays[i], *interval, lowest_m), kSectionDiameters * field.largest_m(octave))) {
          const auto box = footprint_below(rays[i], section, field.largest_m(octave));
          if (!box) {
            add_block(octave);
            break;
          }
          const auto overlap = common(*box, padded_footprint);
          if (overlap) {
            regions.strips.push_back({octave, *overlap});
            expected += expected_rocks(field, octave, *overlap, 0);
          }
        }
      }
    }
  }
  std::sort(regions.octave_blocks.begin(), regions.octave_blocks.end());
  regions.octave_blocks.erase(std::unique(regions.octave_blocks.begin(), regions.octave_blocks.end()),
                              regions.octave_blocks.end());
  for (const auto& [octave, id] : regions.octave_blocks)
    expected += expected_rocks(field, octave, dem::footprint_of(id), 0);
  if (expected > kMaxRocksOfRays) return std::nullopt;
  return regions;
}

std::optional<std::vector<dem::RockFeature>> RocksNearRays::along(std::span<const RayCone> rays,
                                                                  std::span<const BlockOnRays> blocks, double omitted_m,
                                                                  const StopToken& stop) {
  const auto regions = regions_along(rays, blocks, omitted_m, stop);
  if (!regions || !fill_cache(regions->octave_blocks, stop)) return std::nullopt;
  // Strips overlap, so a rock may be found several times; largest_first() drops duplicates.
  auto rocks =
      gathered_in_parallel<dem::RockFeature>(regions->strips.size(), 64, kMaxNewRocks, [&](std::size_t i, auto& out) {
        stop.check();
        survey_.add(regions->strips[i].octave, regions->strips[i].box, survey_.field().law().smallest_m, out, stop);
      });
  if (!rocks) return std::nullopt;
  for (const OctaveBlock& octave_block : regions->octave_blocks) {
    const std::vector<dem::RockFeature>& cached = cache_.at(octave_block);
    rocks->insert(rocks->end(), cached.begin(), cached.end());
  }
  rocks = dem::largest_first(std::move(*rocks));
  if (rocks->size() > kMaxRocksOfRays) return std::nullopt;
  return rocks;
}

// Adds the rocks of the blocks that the cache lacks, in parallel. Returns false if they are too many.
bool RocksNearRays::fill_cache(const std::vector<OctaveBlock>& octave_blocks, const StopToken& stop) {
  const dem::RockField& field = survey_.field();
  if (cached_entries_ > kMaxCachedRocks - kMaxNewRocks) {
    cache_.clear();
    cached_entries_ = 0;
  }
  std::vector<OctaveBlock> missing;
  std::copy_if(octave_blocks.begin(), octave_blocks.end(), std::back_inserter(missing),
               [&](const OctaveBlock& octave_block) { return !cache_.contains(octave_block); });
  std::vector<std::vector<dem::RockFeature>> new_rocks(missing.size());
  std::atomic<std::size_t> new_entries{0};
  in_parallel(missing.size(), [&](std::size_t i) {
    stop.check();
    if (new_entries > kMaxNewRocks) return;
    const auto& [octave, id] = missing[i];
    const dem::Footprint padded_footprint = dem::around(dem::footprint_of(id), field.largest_m(octave));
    survey_.add(octave, padded_footprint, field.law().smallest_m, new_rocks[i], stop);
    new_entries += new_rocks[i].size() + 1;  // a block without rocks takes memory, too
  });
  if (new_entries > kMaxNewRocks) return false;
  for (std::size_t i = 0; i < missing.size(); ++i) cache_.emplace(missing[i], std::move(new_rocks[i]));
  cached_entries_ += new_entries;
  return true;
}

}  // namespace selenograph::engine
