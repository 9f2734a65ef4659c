#include "dem/detail/rocks_on_ground.h"

#include <algorithm>
#include <cmath>

#include "dem/detail/detail.h"
#include "dem/detail/footprints.h"
#include "dem/parallel.h"
#include "dem/surface_place.h"

namespace selenograph::dem {
namespace {

// Where a rock's height is found: posts are half of an octave's smallest diameter apart, or less.
int level_under(int octave) {
  int level = 0;
  while (level < kMaxLevel && post_spacing_m(level) > std::ldexp(0.5, octave)) ++level;
  return level;
}

}  // namespace

double most_rocks(const RockField& field, const Footprint& region, double smallest_m) {
  const RockLaw& law = field.law();
  return area_m2(region) * std::max(1.0, law.on_ejecta) *
         law.frequency.between(std::max(smallest_m, law.smallest_m), law.largest_m);
}

RockSurvey::RockSurvey(const Terrain& terrain)
    : terrain_(terrain), detail_(*terrain.detail()), field_(detail_.rocks()) {}

// Of a block and what is around it: neighbouring pieces ask for the same ones.
RockSurvey::FreshCraters RockSurvey::fresh_around(const BlockId& id) const {
  const std::lock_guard lock(mutex_);
  FreshCraters& kept = fresh_[id];
  if (!kept) {
    const BlockExtent e = extent_of(id);
    const double lat_deg = (lat_deg_of(e.lat0) + lat_deg_of(e.lat1())) / 2,
                 lon_deg = (lon_deg_of(e.lon0) + lon_deg_of(e.lon1())) / 2;
    const double side_m = e.quads * std::max(e.lat_step, e.lon_step) * (kMetresPerDegree / kTicksPerDegree);
    const std::vector<DetailOfPosts> layers = terrain_.detail_at(lat_deg, lon_deg);
    const int posts = std::max_element(layers.begin(), layers.end(), [](const auto& a, const auto& b) {
                        return a.share < b.share;
                      })->level;
    kept = std::make_shared<const std::vector<FreshCrater>>(
        field_.fresh(detail_.craters(), Detail::past_largest_octave(posts),
                     to_cartesian({lat_deg, lon_deg, 0}).normalized(), side_m));
  }
  return kept;
}

void RockSurvey::add(int octave, const Footprint& box, double smallest_m, std::vector<RockFeature>& out,
                     const StopToken& stop) const {
  // Block by block, so that a rock's surroundings are the same whoever asks.
  constexpr int kLevel = 11;  // 950 m wide
  std::vector<Rock> rocks;
  double south = box.south_deg;
  while (south < box.north_deg) {
    double north = std::min(box.north_deg, lat_deg_of(extent_of(block_at_place(kLevel, south, box.west_deg)).lat1()));
    double west = box.west_deg;
    while (west < box.east_deg) {
      const BlockId id = block_at_place(kLevel, south, west);
      double east = std::min(box.east_deg, west + (lon_deg_of(extent_of(id).lon1()) - wrap_lon_deg(west)));
      if (!(east > west)) east = std::nextafter(west, 1000);
      field_.within(octave, {south, north, west, east}, *fresh_around(id), rocks);
      west = east;
    }
    if (!(north > south)) north = std::nextafter(south, 1000);
    south = north;
  }
  for (const Rock& rock : rocks) {
    if (rock.diameter_m < smallest_m) continue;
    stop.check();
    Geographic place = to_geographic(rock.centre * kMoonRadius_m);
    const auto ground = surface_at(terrain_, place.lat_deg, place.lon_deg, level_under(octave), stop);
    if (!ground) continue;
    place.height_m = ground->height_m;
    out.push_back({rock, place, rock.centre * (kMoonRadius_m + ground->height_m), ground->up});
  }
}

std::vector<RockFeature> RockSurvey::within(const Footprint& region, double smallest_m, const StopToken& stop) const {
  struct Piece {
    int octave;
    Footprint box;
  };
  // Cut so that a piece's fresh craters are few.
  constexpr double kPieceDiameters = 64;
  std::vector<Piece> pieces;
  if (field_.empty()) return {};
  for (int k = std::max(field_.smallest_octave(), octave_of(smallest_m)); k <= field_.largest_octave(); ++k)
    for (const Footprint& box : cut(region, std::ldexp(kPieceDiameters, k))) pieces.push_back({k, box});
  return largest_first(gathered_in_parallel<RockFeature>(pieces.size(), 4, [&](std::size_t i, auto& some) {
    stop.check();
    add(pieces[i].octave, pieces[i].box, smallest_m, some, stop);
  }));
}

}  // namespace selenograph::dem
