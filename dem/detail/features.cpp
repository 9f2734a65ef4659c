#include "dem/detail/features.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "dem/detail/detail.h"
#include "dem/detail/footprints.h"
#include "dem/support/parallel.h"
#include "dem/terrain/surface_place.h"

namespace selenograph::dem {
namespace {

using std::numbers::pi;

// A piece's side over the octave's smallest diameter.
constexpr double kPieceDiameters = 32;

double height_m(const CraterField& field, const Crater& crater, const Vec3& place) {
  const double distance_m = (place - crater.centre).norm() * kMoonRadius_m;
  if (distance_m >= crater.reach_m()) return 0;
  return crater.scale * field.shape().height(distance_m / (crater.diameter_m / 2), crater.age);
}

double replaced(const Crater& crater, const Vec3& place) {
  return CraterShape::replaced_at((place - crater.centre).norm() * kMoonRadius_m / (crater.diameter_m / 2), crater.age);
}

}  // namespace

// As Detail::add has it: in the order of their ages, on what has been there before.
CraterRemains remains_of(const CraterField& field, const Crater& crater, std::span<const Crater> candidates) {
  std::vector<Crater> younger;
  for (const Crater& other : candidates)
    if (formed_before(crater, other) &&
        (other.centre - crater.centre).norm() * kMoonRadius_m < other.reach_m() + crater.diameter_m / 2)
      younger.push_back(other);
  std::sort(younger.begin(), younger.end(), formed_before);
  CraterRemains remains;
  for (int i = 0; i < CraterRemains::kRimPoints; ++i) {
    const Vec3 place = CraterSurvey::on_rim(crater, 2 * pi * i / CraterRemains::kRimPoints);
    const double own_m = height_m(field, crater, place);
    double now_m = own_m;
    for (const Crater& other : younger) now_m = now_m * (1 - replaced(other, place)) + height_m(field, other, place);
    remains.rim[static_cast<std::size_t>(i)] = std::abs(now_m - own_m) <= crater.depth_m / 4;
  }
  for (const Crater& other : younger) remains.floor *= 1 - replaced(other, crater.centre);
  return remains;
}

double expected_craters(const CraterField& field, const Footprint& region, double smallest_m) {
  const CraterLaw& law = field.law();
  return area_m2(region) * law.frequency.between(std::max(smallest_m, law.smallest_m), law.largest_m);
}

CraterSurvey::CraterSurvey(const Terrain& terrain)
    : plain_(terrain.plain()), detailed_(terrain), field_(terrain.detail()->craters()) {}

std::vector<CraterSurvey::Piece> CraterSurvey::pieces(const Footprint& region, double smallest_m) const {
  std::vector<Piece> pieces;
  for (int k = std::max(field_.smallest_octave(), octave_of(smallest_m)); k <= field_.largest_octave(); ++k)
    for (const Footprint& box : cut(region, std::ldexp(kPieceDiameters, k))) pieces.push_back({k, box});
  return pieces;
}

std::vector<CraterFeature> CraterSurvey::within(const Footprint& region, double smallest_m,
                                                const StopToken& stop) const {
  const std::vector<Piece> all = pieces(region, smallest_m);
  return largest_first(gathered_in_parallel<CraterFeature>(all.size(), 4, [&](std::size_t i, auto& some) {
    stop.check();
    survey(all[i], smallest_m, stop, some);
  }));
}

void CraterSurvey::survey(const Piece& piece, double smallest_m, const StopToken& stop,
                          std::vector<CraterFeature>& out) const {
  // Those that reach the rim of one with its centre in the box.
  const double largest_m = std::ldexp(2.0, piece.octave);
  const double margin_m = (CraterShape::reach(CraterShape::kOldest) + 1) * largest_m / 2;
  const Footprint wide = around(piece.box, margin_m);
  const std::vector<Crater> all = field_.within(piece.octave, wide, stop);
  for (const Crater& crater : all) {
    stop.check();
    if (crater.diameter_m >= smallest_m && holds(piece.box, to_geographic(crater.centre * kMoonRadius_m)))
      add_if_shown(crater, piece.octave, all, out, stop);
  }
}

void CraterSurvey::near(int octave, const Vec3& direction, double radius_m, std::vector<Crater>& out,
                        const StopToken& stop) const {
  const std::size_t before = out.size();
  field_.near(octave, direction, radius_m, out, stop);
  const auto away = [&](const Crater& c) {
    return (c.centre - direction).norm() * kMoonRadius_m > radius_m + c.diameter_m / 2;
  };
  out.erase(std::remove_if(out.begin() + static_cast<std::ptrdiff_t>(before), out.end(), away), out.end());
}

void CraterSurvey::add_if_shown(const Crater& crater, int octave, std::vector<CraterFeature>& out,
                                const StopToken& stop) const {
  std::vector<Crater> others;
  field_.near(octave, crater.centre, crater.diameter_m / 2, others, stop);
  add_if_shown(crater, octave, others, out, stop);
}

void CraterSurvey::add_if_shown(const Crater& crater, int octave, std::span<const Crater> candidates,
                                std::vector<CraterFeature>& out, const StopToken& stop) const {
  CraterFeature feature{crater, octave, to_geographic(crater.centre * kMoonRadius_m), 0};
  Geographic& place = feature.place;
  const double share = this->share(octave, place);
  if (!(share > 0.5)) return;
  feature.depth_m = share * crater.depth_m;
  place.height_m = plain_.height(place.lat_deg, place.lon_deg, stop).height_m;
  if (std::isnan(place.height_m)) return;
  const CraterRemains remains = remains_of(field_, crater, candidates);
  if (!remains.any()) return;
  int shown = 0;
  for (int i = 0; i < CraterRemains::kRimPoints; ++i) {
    if (!remains.rim[static_cast<std::size_t>(i)]) continue;
    const Geographic g = to_geographic(on_rim(crater, 2 * pi * i / CraterRemains::kRimPoints) * kMoonRadius_m);
    shown += shows(octave, g) && !std::isnan(plain_.height(g.lat_deg, g.lon_deg, stop).height_m);
  }
  feature.rim_share = static_cast<double>(shown) / CraterRemains::kRimPoints;
  out.push_back(feature);
}

// In the block of the finest surface: what DetailedTerrain asks.
double CraterSurvey::share(int octave, const Geographic& place) const {
  const int level = finest_level_at(detailed_, place.lat_deg, place.lon_deg);
  double share = 0;
  for (const DetailOfPosts& layer : detailed_.detail_at(place.lat_deg, place.lon_deg))
    if (level > layer.level && octave < Detail::past_largest_octave(layer.level)) share += layer.share;
  return share;
}

Vec3 CraterSurvey::on_rim(const Crater& crater, double angle) {
  const EastNorthUp axes = local_axes(crater.centre);
  // The field's distances are chords.
  const double away = 2 * std::asin(crater.diameter_m / 4 / kMoonRadius_m);
  return std::cos(away) * axes.up + std::sin(away) * (std::cos(angle) * axes.north + std::sin(angle) * axes.east);
}

}  // namespace selenograph::dem
