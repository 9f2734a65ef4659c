#include "dem/detail/crater_field.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "dem/detail/footprints.h"

namespace selenograph::dem {

// A crater reaches 4.8 radii, so that those which reach a place are in its cell or in one beside it.
static_assert(SizeCells::kCellDiameters > 4.8);

SizeFrequency equilibrium() { return {{{std::pow(10, -1.1), 2}}}; }

double fresh_depth_over_diameter(double diameter_m) {
  struct Median {
    double diameter_m, ratio;
  };
  static constexpr std::array<Median, 5> kMedians{{{10, 0.11}, {40, 0.13}, {100, 0.15}, {200, 0.17}, {400, 0.21}}};
  const auto above =
      std::find_if(kMedians.begin(), kMedians.end(), [&](const Median& m) { return m.diameter_m > diameter_m; });
  if (above == kMedians.end()) return kMedians.back().ratio;
  // "less below": by the slope between 10 and 40 m, and no less than 0.08.
  const Median& high = above == kMedians.begin() ? kMedians[1] : *above;
  const Median& low = above == kMedians.begin() ? kMedians[0] : *(above - 1);
  const double share = std::log(diameter_m / low.diameter_m) / std::log(high.diameter_m / low.diameter_m);
  return std::max(0.08, low.ratio + share * (high.ratio - low.ratio));
}

CraterField::CraterField(const CraterLaw& law, const Region& of_centres)
    : law_(law), region_(of_centres), cells_(law.seed, law.frequency, law.smallest_m, law.largest_m) {}

Crater CraterField::made(Draws& draws, const Vec3& centre, double diameter_m) const {
  Crater crater;
  crater.centre = centre, crater.diameter_m = diameter_m;
  const double radius2 = diameter_m * diameter_m / 4;
  const double until_Ma = std::min(law_.oldest_Ma, CraterShape::kOldest * radius2 / law_.diffusivity_m2_per_Ma);
  crater.age_Ma = draws.uniform() * until_Ma;
  crater.age = law_.diffusivity_m2_per_Ma * crater.age_Ma / radius2;
  // Within three standard deviations: what is reported as the deepest is.
  const double ratio = fresh_depth_over_diameter(diameter_m) + kDepthScatter * std::clamp(draws.normal(), -3.0, 3.0);
  crater.scale = diameter_m * std::max(0.0, ratio) / CraterShape::kFreshDepth;
  crater.depth_m = diameter_m * std::max(0.0, ratio) * shape_.depth_left(crater.age);
  crater.id = draws.bits();
  return crater;
}

void CraterField::near(int octave, const Vec3& direction, double radius_m, std::vector<Crater>& out,
                       const StopToken& stop) const {
  const double reach_m = CraterShape::reach(CraterShape::kOldest) * cells_.largest_m(octave) / 2;
  cells_.near(octave, direction, (radius_m + reach_m) / kMoonRadius_m, stop,
              [&](Draws& draws, const Vec3& centre, double diameter_m) {
                const Crater crater = made(draws, centre, diameter_m);
                if ((centre - direction).norm() * kMoonRadius_m <= radius_m + crater.reach_m() && region_.holds(centre))
                  out.push_back(crater);
              });
}

std::vector<Crater> CraterField::within(int octave, const Footprint& box, const StopToken& stop) const {
  std::vector<Crater> out;
  cells_.in_box(octave, box, stop, [&](Draws& draws, const Vec3& centre, double diameter_m) {
    const Crater crater = made(draws, centre, diameter_m);
    if (holds(box, to_geographic(centre * kMoonRadius_m)) && region_.holds(centre)) out.push_back(crater);
  });
  return out;
}

double CraterField::deepest_m(int octave) const {
  const double diameter_m = cells_.largest_m(octave);
  return diameter_m * (fresh_depth_over_diameter(diameter_m) + 3 * kDepthScatter) * 0.228809953 /
         CraterShape::kFreshDepth;
}

double CraterField::highest_m(int octave) const {
  const double diameter_m = cells_.largest_m(octave);
  return diameter_m * (fresh_depth_over_diameter(diameter_m) + 3 * kDepthScatter) * 0.036822095 /
         CraterShape::kFreshDepth;
}

}  // namespace selenograph::dem
