#include "dem/detail/rocks_on_ground.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/detail/detail.h"
#include "dem/detail/footprints.h"
#include "dem/terrain/surface_place.h"

namespace selenograph::dem {
namespace {

// Returns the level on which rocks of an octave stand: its posts are at most half the octave's smallest diameter apart.
int level_under(int octave) {
  int level = 0;
  while (level < kMaxLevel && post_spacing_m(level) > std::ldexp(0.5, octave)) ++level;
  return level;
}

// Returns the level of block_around(): its blocks are 950 m wide, or at most 32 of the smallest craters that have
// rocks. So never more than some thousands of fresh craters surround a block.
int level_of_surroundings(const RockLaw& law) {
  constexpr double kQuads = 64, kCraters = 32;
  int level = 11;
  while (level < kMaxLevel && kQuads * post_spacing_m(level) > kCraters * law.smallest_crater_m) ++level;
  return level;
}

// Smallest diameters of cached lists: four per octave, equally spaced.
constexpr int kSteps = 4;
int step_of(int octave, double diameter_m) {
  const double above = std::ldexp(diameter_m, -octave) - 1;
  return std::clamp(static_cast<int>(std::floor(above * kSteps)), 0, kSteps - 1);
}
double diameter_of(int octave, int step) { return std::ldexp(1 + static_cast<double>(step) / kSteps, octave); }

template <typename T>
std::size_t bytes_of(const std::vector<T>& list) {
  constexpr std::size_t kBytesOfEntry = 256;
  return kBytesOfEntry + list.capacity() * sizeof(T);
}

}  // namespace

std::size_t RockMemory::KeyHash::operator()(const Key& key) const {
  const std::size_t numbers = static_cast<std::size_t>((key.detail * 64 + key.octave) * kSteps + key.min_step);
  return BlockIdHash()(key.block) ^ numbers * 0x9e3779b97f4a7c15;
}

double max_expected_rocks(const RockField& field, const Footprint& region, double smallest_m) {
  const RockLaw& law = field.law();
  // Average the enrichment, 1 inside the crater's radius and radii^-3 outside, over a disc as large as the region:
  // (pi + 2 pi (1 - 1 / radii)) / (pi radii^2).
  constexpr double kLargestRadius_m = 250;
  const double area = area_m2(region), radii = std::sqrt(area / std::numbers::pi) / kLargestRadius_m,
               mean = radii <= 1 ? 1 : (3 - 2 / radii) / (radii * radii);
  return area * (1 + std::max(0.0, law.on_ejecta - 1) * mean) *
         law.frequency.between(std::max(smallest_m, law.smallest_m), law.largest_m);
}

RockSurvey::RockSurvey(const Terrain& terrain, std::shared_ptr<RockMemory> memory)
    : terrain_(*terrain.detailed()),
      detail_(terrain_.detail()),
      field_(detail_.rocks()),
      memory_(memory ? std::move(memory) : std::make_shared<RockMemory>(kKeptBytes)) {}

BlockId RockSurvey::block_around(double lat_deg, double lon_deg) const {
  return block_at_place(level_of_surroundings(field_.law()), lat_deg, lon_deg);
}

// The layer with the largest share at the block's middle decides which craters its ground shows.
std::shared_ptr<const RockSurvey::FreshCraters> RockSurvey::fresh_around(const BlockId& id,
                                                                         const StopToken& stop) const {
  const auto find = [&] {
    const Footprint box = footprint_of(id);
    const double lat_deg = (box.south_deg + box.north_deg) / 2, lon_deg = (box.west_deg + box.east_deg) / 2;
    const std::vector<DetailOfPosts> layers = terrain_.detail_at(lat_deg, lon_deg);
    const int posts = std::max_element(layers.begin(), layers.end(), [](const auto& a, const auto& b) {
                        return a.share < b.share;
                      })->level;
    const Circle reach = circle_around(box);  // in metres: degrees of longitude are short near a pole
    auto found = std::make_shared<const FreshCraters>(
        field_.fresh(detail_.craters(), Detail::past_largest_octave(posts), reach.middle, reach.radius_m, stop));
    const std::size_t bytes = bytes_of(*found);
    return decltype(memory_->fresh_)::Loaded{std::move(found), bytes};
  };
  return memory_->fresh_.get({id, terrain_.detail_number()}, find, stop);
}

void RockSurvey::add(int octave, const BlockId& block, double smallest_m, std::vector<RockFeature>& out,
                     const StopToken& stop) const {
  const int min_step = step_of(octave, smallest_m);
  const auto find = [&] {
    std::vector<RockFeature> rocks;
    add(octave, footprint_of(block), diameter_of(octave, min_step), rocks, stop);
    rocks.shrink_to_fit();
    const std::size_t bytes = bytes_of(rocks);
    return decltype(memory_->rocks_)::Loaded{std::make_shared<const std::vector<RockFeature>>(std::move(rocks)), bytes};
  };
  const auto cached = memory_->rocks_.get({block, terrain_.detail_number(), octave, min_step}, find, stop);
  std::copy_if(cached->begin(), cached->end(), std::back_inserter(out),
               [&](const RockFeature& rock) { return rock.rock.diameter_m >= smallest_m; });
}

void RockSurvey::add(int octave, const Footprint& box, double smallest_m, std::vector<RockFeature>& out,
                     const StopToken& stop) const {
  // Walk the blocks of block_around() under the box, and query each with its own fresh craters.
  std::vector<Rock> rocks;
  double south = box.south_deg;
  while (south < box.north_deg) {
    double north = std::min(box.north_deg, lat_deg_of(extent_of(block_around(south, box.west_deg)).lat1()));
    double west = box.west_deg;
    while (west < box.east_deg) {
      const BlockId id = block_around(south, west);
      double east = std::min(box.east_deg, west + (lon_deg_of(extent_of(id).lon1()) - wrap_lon_deg(west)));
      if (!(east > west)) east = std::nextafter(west, 1000);
      field_.in_box(octave, {south, north, west, east}, *fresh_around(id, stop), rocks, stop);
      west = east;
    }
    if (!(north > south)) north = std::nextafter(south, 1000);
    south = north;
  }
  for (const Rock& rock : rocks) {
    if (rock.diameter_m < smallest_m) continue;
    stop.check();
    Geographic position = to_geographic(rock.centre * kMoonRadius_m);
    // Make single quads where the block is not cached: few rocks lie in a block.
    const int level = std::min(level_under(octave), finest_level_at(terrain_, position.lat_deg, position.lon_deg));
    const Ticks at = ticks_of(position.lat_deg, position.lon_deg);
    const auto block = terrain_.block_or_quad(at.block(level), at.whole_lat, at.whole_lon, stop);
    const auto ground = block ? surface_on(*block, position.lat_deg, position.lon_deg) : std::nullopt;
    if (!ground) continue;
    position.height_m = ground->height_m;
    out.push_back({rock, position, rock.centre * (kMoonRadius_m + ground->height_m), ground->up});
  }
}

std::vector<RockFeature> RockSurvey::rocks_in(const Footprint& region, double smallest_m, const StopToken& stop) const {
  struct OctaveBox {
    int octave;
    Footprint box;
  };
  // Cut the region into boxes small enough to have few fresh craters.
  constexpr double kBoxDiameters = 64;
  std::vector<OctaveBox> boxes;
  if (field_.empty()) return {};
  for (int k = std::max(field_.smallest_octave(), octave_of(smallest_m)); k <= field_.largest_octave(); ++k) {
    stop.check();
    for (const Footprint& box : cut(region, std::ldexp(kBoxDiameters, k), stop)) boxes.push_back({k, box});
  }
  return largest_first(gathered_in_parallel<RockFeature>(boxes.size(), 4, [&](std::size_t i, auto& found) {
    stop.check();
    add(boxes[i].octave, boxes[i].box, smallest_m, found, stop);
  }));
}

}  // namespace selenograph::dem
