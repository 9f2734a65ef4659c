#include "dem/detail/crater_field.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>

#include "dem/base/pool.h"
#include "dem/detail/footprints.h"

namespace selenograph::dem {

SizeFrequency equilibrium() { return {{{std::pow(10, -1.1), 2}}}; }

double fresh_depth_over_diameter(double diameter_m) {
  struct Median {
    double diameter_m, ratio;
  };
  static constexpr std::array<Median, 6> kMedians{
      {{3, 0.14}, {10, 0.11}, {40, 0.13}, {100, 0.15}, {200, 0.17}, {400, 0.21}}};
  const auto above =
      std::find_if(kMedians.begin(), kMedians.end(), [&](const Median& m) { return m.diameter_m > diameter_m; });
  if (above == kMedians.end()) return kMedians.back().ratio;
  if (above == kMedians.begin()) return kMedians.front().ratio;
  const Median &high = *above, &low = *(above - 1);
  const double share = std::log(diameter_m / low.diameter_m) / std::log(high.diameter_m / low.diameter_m);
  return low.ratio + share * (high.ratio - low.ratio);
}

double fresh_ratio(double diameter_m, double normal_deviate) {
  constexpr double kShallowest = 1.2 * kVisible;
  return std::max(kShallowest,
                  fresh_depth_over_diameter(diameter_m) + kDepthScatter * std::clamp(normal_deviate, -3.0, 3.0));
}

double round_radii(const Crater& crater, const Vec3& direction) {
  const Vec3 from_centre = direction - crater.centre;
  const double chord = from_centre.norm();
  if (chord == 0) return 0;
  const EastNorthUp axes = local_axes(crater.centre);
  return crater.outline.round(chord * kMoonRadius_m / (crater.diameter_m / 2), axes.east.dot(from_centre) / chord,
                              axes.north.dot(from_centre) / chord, CraterShape::reach(crater.age));
}

namespace {

// Returns a number that no other field of the process has.
std::uint64_t next_field_id() {
  static std::atomic<std::uint64_t> next{1};
  return next++;
}

}  // namespace

// Direct-mapped, 48 x 48 entries, indexed by row and column modulo 48: up to that many adjacent cells do not collide.
// Octaves are shifted against each other.
class CraterField::CellCache {
 public:
  // Returns all craters whose centre is in a cell. The reference is valid until the next call.
  const std::vector<Crater>& craters_in(const CraterField& field, const SizeCells::Cell& cell) {
    const auto [octave, row, column] = cell;
    const auto slot = [](int index) { return static_cast<std::size_t>(index) % kSide; };
    Entry& entry = entries_[slot(row + 5 * octave) * kSide + slot(column + 7 * octave)];
    if (entry.field_id == field.id_ && entry.cell == cell) return entry.craters;
    entry.field_id = 0;  // until it is complete: drawing may throw
    entry.craters.clear();
    field.cells_.draw_cell(cell, [&](Draws& draws, const Vec3& centre, double diameter_m) {
      if (const auto crater = field.draw_crater(draws, centre, diameter_m); crater && field.region_.holds(centre))
        entry.craters.push_back(*crater);
    });
    entry.field_id = field.id_;
    entry.cell = cell;
    return entry.craters;
  }

 private:
  struct Entry {
    std::uint64_t field_id = 0;  // 0: invalid
    SizeCells::Cell cell{};
    std::vector<Crater> craters;
  };
  static constexpr std::size_t kSide = 48;
  std::array<Entry, kSide * kSide> entries_;
};

Pool<CraterField::CellCache>& CraterField::cell_caches() {
  static Pool<CellCache> caches;
  return caches;
}

CraterField::CraterField(const CraterLaw& law, const Region& region_of_centres)
    : id_(next_field_id()),
      law_(law),
      ages_(law.frequency, law.smallest_m, law.largest_m, law.oldest_Ma),
      region_(region_of_centres),
      cells_(law.seed, law.frequency, law.smallest_m, law.largest_m) {}

double CraterField::number_per_m2(double smallest_m) const {
  const double from_m = std::max(smallest_m, law_.smallest_m);
  return from_m < law_.largest_m ? ages_.number_per_m2(from_m, law_.largest_m) : 0;
}

// Draws the same numbers in the same order for every crater: later draws of a cell depend on them.
std::optional<Crater> CraterField::draw_crater(Draws& draws, const Vec3& centre, double diameter_m) const {
  const CraterAges::Life life = ages_.life(diameter_m);
  // The law counts the craters of a size in equilibrium. Of larger ones only a share has formed: drop the others.
  const double formation_rank = draws.uniform(), age_share = draws.uniform();
  const double ratio = fresh_ratio(diameter_m, draws.normal());
  const std::uint64_t id = draws.bits();
  if (formation_rank > life.share) return std::nullopt;
  Crater crater{centre, diameter_m, 0, 0, 0, diameter_m * ratio / CraterShape::kFreshDepth, id, {}};
  const double formed_since = age_share * life.oldest;  // craters formed since this one, by production_times()
  crater.age_Ma = age_Ma_of(formed_since);
  crater.age = formed_since / life.worn_out * shape().age_of(kVisible / ratio);
  crater.depth_m = diameter_m * ratio * shape().depth_left(crater.age);
  crater.outline = CraterOutline(id, diameter_m, crater.age);
  return crater;
}

void CraterField::near(int octave, const Vec3& direction, double radius_m, std::vector<Crater>& out,
                       const StopToken& stop) const {
  const double reach_m = CraterShape::reach(CraterShape::kOldest) * cells_.largest_m(octave) / 2;
  const Pool<CellCache>::Lease cache(cell_caches());
  cells_.cells_near(octave, direction, (radius_m + reach_m) / kMoonRadius_m, stop, [&](const SizeCells::Cell& cell) {
    for (const Crater& crater : cache->craters_in(*this, cell))
      if ((crater.centre - direction).norm() * kMoonRadius_m - radius_m <= crater.reach_m()) out.push_back(crater);
  });
}

void CraterField::within(int octave, const Vec3& direction, double distance_m, std::vector<Crater>& out,
                         const StopToken& stop) const {
  const Pool<CellCache>::Lease cache(cell_caches());
  cells_.cells_near(octave, direction, distance_m / kMoonRadius_m, stop, [&](const SizeCells::Cell& cell) {
    const std::vector<Crater>& craters = cache->craters_in(*this, cell);
    out.insert(out.end(), craters.begin(), craters.end());
  });
}

std::vector<Crater> CraterField::in_box(int octave, const Footprint& box, const StopToken& stop) const {
  std::vector<Crater> out;
  cells_.in_box(octave, box, stop, [&](Draws& draws, const Vec3& centre, double diameter_m) {
    const auto crater = draw_crater(draws, centre, diameter_m);
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
