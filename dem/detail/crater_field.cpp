#include "dem/detail/crater_field.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>

#include "dem/detail/footprints.h"

namespace selenograph::dem {

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

namespace {

std::uint64_t next_number() {
  static std::atomic<std::uint64_t> next{1};
  return next++;
}

}  // namespace

CraterField::CraterField(const CraterLaw& law, const Region& of_centres)
    : number_(next_number()),
      law_(law),
      ages_(law.frequency, law.smallest_m, law.largest_m, law.oldest_Ma),
      region_(of_centres),
      cells_(law.seed, law.frequency, law.smallest_m, law.largest_m) {}

double CraterField::number_per_m2(double smallest_m) const {
  const double from_m = std::max(smallest_m, law_.smallest_m);
  return from_m < law_.largest_m ? ages_.number_per_m2(from_m, law_.largest_m) : 0;
}

std::optional<Crater> CraterField::made(Draws& draws, const Vec3& centre, double diameter_m) const {
  const CraterAges::Life life = ages_.life(diameter_m);
  const double formed = draws.uniform(), when = draws.uniform();
  // Within three standard deviations: what is reported as the deepest is. All are visible at first.
  constexpr double kShallowest = 1.2 * kVisible;
  const double ratio = std::max(
      kShallowest, fresh_depth_over_diameter(diameter_m) + kDepthScatter * std::clamp(draws.normal(), -3.0, 3.0));
  const std::uint64_t id = draws.bits();
  if (formed > life.share) return std::nullopt;
  Crater crater{centre, diameter_m, 0, 0, 0, diameter_m * ratio / CraterShape::kFreshDepth, id};
  const double formed_since = when * life.oldest;
  crater.age_Ma = age_Ma_of(formed_since);
  crater.age = formed_since / life.worn_out * shape().age_of(kVisible / ratio);
  crater.depth_m = diameter_m * ratio * shape().depth_left(crater.age);
  return crater;
}

const std::vector<Crater>& CraterField::in_cell(const SizeCells::Cell& cell) const {
  struct Kept {
    std::uint64_t number = 0;
    SizeCells::Cell cell{};
    std::vector<Crater> craters;
  };
  constexpr std::size_t kSide = 48;  // cells around a place have places of their own
  static thread_local std::array<Kept, kSide * kSide> all;
  const auto [octave, row, column] = cell;
  const auto place = [](int index) { return static_cast<std::size_t>(index) % kSide; };
  Kept& kept = all[place(row + 5 * octave) * kSide + place(column + 7 * octave)];
  if (kept.number == number_ && kept.cell == cell) return kept.craters;
  kept.number = 0, kept.craters.clear();
  cells_.within(cell, [&](Draws& draws, const Vec3& centre, double diameter_m) {
    if (const auto crater = made(draws, centre, diameter_m); crater && region_.holds(centre))
      kept.craters.push_back(*crater);
  });
  kept.number = number_, kept.cell = cell;
  return kept.craters;
}

void CraterField::near(int octave, const Vec3& direction, double radius_m, std::vector<Crater>& out,
                       const StopToken& stop) const {
  const double reach_m = CraterShape::reach(CraterShape::kOldest) * cells_.largest_m(octave) / 2;
  cells_.cells_near(octave, direction, (radius_m + reach_m) / kMoonRadius_m, stop, [&](const SizeCells::Cell& cell) {
    for (const Crater& crater : in_cell(cell))
      if ((crater.centre - direction).norm() * kMoonRadius_m - radius_m <= crater.reach_m()) out.push_back(crater);
  });
}

std::vector<Crater> CraterField::within(int octave, const Footprint& box, const StopToken& stop) const {
  std::vector<Crater> out;
  cells_.in_box(octave, box, stop, [&](Draws& draws, const Vec3& centre, double diameter_m) {
    const auto crater = made(draws, centre, diameter_m);
    if (crater && holds(box, to_geographic(centre * kMoonRadius_m)) && region_.holds(centre)) out.push_back(*crater);
  });
  return out;
}

double CraterField::deepest_m(int octave) const {
  const double diameter_m = cells_.largest_m(octave);
  return diameter_m * (fresh_depth_over_diameter(diameter_m) + 3 * kDepthScatter) * shape().deepest() /
         CraterShape::kFreshDepth;
}

double CraterField::highest_m(int octave) const {
  const double diameter_m = cells_.largest_m(octave);
  return diameter_m * (fresh_depth_over_diameter(diameter_m) + 3 * kDepthScatter) * shape().highest() /
         CraterShape::kFreshDepth;
}

}  // namespace selenograph::dem
