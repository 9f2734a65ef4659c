#include "dem/detail/rock_field.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "dem/detail/footprints.h"

namespace selenograph::dem {
namespace {

// Constants that make the rocks' seeds differ from the craters' of the same preset.
constexpr std::uint64_t kRocks = 0x9e3779b97f4a7c15, kEjecta = 0xc2b2ae3d27d4eb4f;
// Excess over the rocks between craters below which a crater counts as old, and distance in radii at which ejecta end.
constexpr double kMinExcess = 0.05, kMaxRadii = 8;

}  // namespace

SizeFrequency rocks_of_viper() { return {{{0.0003, 2.482}}}; }
SizeFrequency rocks_of_haworth() { return {{{0.002, 2.6607}}}; }

RockField::RockField(const RockLaw& law, const Region& region_of_centres)
    : law_(law),
      region_(region_of_centres),
      cells_(law.seed ^ kRocks, law.frequency, law.smallest_m, law.largest_m),
      ejecta_(law.seed ^ kEjecta, law.frequency, law.smallest_m, law.largest_m, std::max(0.0, law.on_ejecta - 1)) {}

void RockField::settle(Rock& rock) const {
  Draws draws(rock.form, 0, 0, 0);
  rock.worn = 1 - std::exp2(-rock.age_Ma / law_.half_life_Ma);
  const double height_over_diameter = 0.6 + 0.4 * draws.uniform();
  const double buried_on_landing = 0.05 + 0.3 * draws.uniform();
  const double buried_by_age = 0.05 + 0.35 * draws.uniform();
  const double fillet_over_height = 0.18 + 0.12 * draws.uniform();
  rock.buried = buried_on_landing + buried_by_age * rock.worn;
  rock.height_m = rock.diameter_m * height_over_diameter * (1 - rock.buried);
  rock.brightness = 1 + law_.albedo_variation * (kBrighter + kBrighterScatter * std::clamp(draws.normal(), -2.0, 2.0));
  rock.fillet_m = std::min(rock.height_m * fillet_over_height * std::sqrt(rock.worn), 0.1 * rock.diameter_m);
}

double RockField::enriched(double age_Ma, double radii) const {
  if (radii > kMaxRadii) return 0;
  const double outward = std::max(1.0, radii);
  return std::exp2(-age_Ma / law_.half_life_Ma) / (outward * outward * outward);
}

std::vector<FreshCrater> RockField::fresh(const CraterField& craters, int past_largest_crater, const Vec3& direction,
                                          double radius_m, const StopToken& stop) const {
  std::vector<FreshCrater> fresh;
  if (empty() || law_.on_ejecta <= 1) return fresh;
  std::vector<Crater> near;  // craters of the current octave
  const int first = std::max(craters.smallest_octave(), octave_of(law_.smallest_crater_m));
  for (int k = first; k <= std::min(craters.largest_octave(), past_largest_crater - 1); ++k) {
    near.clear();
    craters.near(k, direction, radius_m + kMaxRadii * craters.largest_m(k) / 2, near, stop);
    for (const Crater& c : near) {
      const double reach_m = radius_m + kMaxRadii * c.diameter_m / 2;
      if (c.diameter_m >= law_.smallest_crater_m && (law_.on_ejecta - 1) * enriched(c.age_Ma, 1) >= kMinExcess &&
          (c.centre - direction).norm() * kMoonRadius_m <= reach_m + 1)
        fresh.push_back({c.centre, c.diameter_m / 2, c.age_Ma});
    }
  }
  return fresh;
}

// Draws two populations: rocks between craters everywhere, and rocks of ejecta near fresh craters.
void RockField::in_box(int octave, const Footprint& box, std::span<const FreshCrater> fresh, std::vector<Rock>& out,
                       const StopToken& stop) const {
  if (empty()) return;
  const auto add = [&](Rock& rock) {
    if (!holds(box, to_geographic(rock.centre * kMoonRadius_m)) || !region_.holds(rock.centre)) return;
    settle(rock);
    out.push_back(rock);
  };
  cells_.in_box(octave, box, stop, [&](Draws& draws, const Vec3& centre, double diameter_m) {
    // Ages of surviving rocks are distributed exponentially, with the law's half life.
    const double survived = draws.uniform();
    Rock rock{centre, diameter_m, -law_.half_life_Ma * std::log2(survived), draws.bits(), draws.bits()};
    add(rock);
  });
  std::vector<FreshCrater> near;
  const Circle reach = circle_around(box);
  std::copy_if(fresh.begin(), fresh.end(), std::back_inserter(near), [&](const FreshCrater& c) {
    return (c.centre - reach.middle).norm() * kMoonRadius_m <= reach.radius_m + 1 + kMaxRadii * c.radius_m;
  });
  if (near.empty()) return;
  // Draw the population of the largest density, and keep each rock with the probability of the enrichment at it.
  ejecta_.in_box(octave, box, stop, [&](Draws& draws, const Vec3& centre, double diameter_m) {
    const double rank = draws.uniform();
    Rock rock{centre, diameter_m, 0, draws.bits(), draws.bits()};
    double highest = 0;
    for (const FreshCrater& crater : near) {
      const double enrichment =
          enriched(crater.age_Ma, (centre - crater.centre).norm() * kMoonRadius_m / crater.radius_m);
      if (enrichment > highest) {
        highest = enrichment;
        rock.age_Ma = crater.age_Ma;
      }
    }
    if (highest > rank) add(rock);
  });
}

}  // namespace selenograph::dem
