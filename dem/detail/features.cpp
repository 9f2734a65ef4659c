#include "dem/detail/features.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/detail/detail.h"
#include "dem/detail/footprints.h"
#include "dem/detail/means_taken.h"
#include "dem/terrain/surface_place.h"

namespace selenograph::dem {
namespace {

using std::numbers::pi;

double height_m(const CraterField& field, const Crater& crater, const Vec3& place) {
  const double distance_m = (place - crater.centre).norm() * kMoonRadius_m;
  if (distance_m >= crater.reach_m()) return 0;
  return crater.scale * field.shape().height(distance_m / (crater.diameter_m / 2), crater.age);
}

// Whether a layer leaves an octave to the detail.
bool has(const DetailOfPosts& layer, int octave) { return octave < Detail::past_largest_octave(layer.level); }

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
  return area_m2(region) * field.number_per_m2(smallest_m);
}

CraterSurvey::CraterSurvey(const Terrain& terrain, std::shared_ptr<const CraterRoughness> roughness)
    : plain_(terrain.plain()),
      detailed_(terrain),
      field_(terrain.detail()->craters()),
      roughness_(std::move(roughness)) {}

std::vector<CraterSurvey::Piece> CraterSurvey::pieces(const Footprint& region, double smallest_m,
                                                      const StopToken& stop) const {
  std::vector<Piece> pieces;
  for (int k = std::max(field_.smallest_octave(), octave_of(smallest_m)); k <= field_.largest_octave(); ++k)
    for (const Footprint& box : cut(region, std::ldexp(kBoxDiameters, k), stop)) pieces.push_back({k, box});
  return pieces;
}

std::vector<CraterFeature> CraterSurvey::within(const Footprint& region, double smallest_m, double least_depth,
                                                const StopToken& stop) const {
  const std::vector<Piece> all = pieces(region, smallest_m, stop);
  const auto wanted = [&](const Crater& crater) { return crater.diameter_m >= smallest_m; };
  return largest_first(gathered_in_parallel<CraterFeature>(all.size(), 4, [&](std::size_t i, auto& some) {
    stop.check();
    within(all[i].octave, all[i].box, least_depth, wanted, some, stop);
  }));
}

void CraterSurvey::within(int octave, const Footprint& box, double least_depth,
                          const std::function<bool(const Crater&)>& wanted, std::vector<CraterFeature>& out,
                          const StopToken& stop) const {
  // Those that reach the rim of one with its centre in the box.
  const double largest_m = std::ldexp(2.0, octave);
  const double margin_m = (CraterShape::reach(CraterShape::kOldest) + 1) * largest_m / 2;
  const std::vector<Crater> all = field_.within(octave, around(box, margin_m), stop);
  for (const Crater& crater : all) {
    stop.check();
    if (crater.depth_m >= least_depth * crater.diameter_m && wanted(crater) &&
        holds(box, to_geographic(crater.centre * kMoonRadius_m)))
      add_if_shown(crater, octave, least_depth, all, out, stop);
  }
}

void CraterSurvey::add_if_shown(const Crater& crater, int octave, double least_depth,
                                std::span<const Crater> candidates, std::vector<CraterFeature>& out,
                                const StopToken& stop) const {
  CraterFeature feature{crater, octave, to_geographic(crater.centre * kMoonRadius_m), 0};
  Geographic& place = feature.place;
  const std::vector<DetailOfPosts> layers = layers_at(place);
  const double share = this->share(octave, layers);
  if (!(share > 0.5)) return;
  if (share * crater.depth_m < least_depth * crater.diameter_m) return;
  for (const DetailOfPosts& layer : layers)
    if (has(layer, octave)) feature.depth_m += layer.share * depth_left(crater, layer.level) * crater.depth_m;
  if (feature.depth_over_diameter() < least_depth) return;
  place.height_m = plain_.height(place.lat_deg, place.lon_deg, stop).height_m;
  if (std::isnan(place.height_m)) return;
  feature.visibility =
      std::min(feature.depth_m / roughness_m(crater.diameter_m, layers), CraterRoughness::kMostVisible);
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
std::vector<DetailOfPosts> CraterSurvey::layers_at(const Geographic& place) const {
  const int level = finest_level_at(detailed_, place.lat_deg, place.lon_deg);
  std::vector<DetailOfPosts> layers = detailed_.detail_at(place.lat_deg, place.lon_deg);
  std::erase_if(layers, [&](const DetailOfPosts& layer) { return level <= layer.level; });
  return layers;
}

double CraterSurvey::share(int octave, std::span<const DetailOfPosts> layers) {
  double share = 0;
  for (const DetailOfPosts& layer : layers)
    if (has(layer, octave)) share += layer.share;
  return share;
}

double CraterSurvey::roughness_m(double diameter_m, std::span<const DetailOfPosts> layers) const {
  double sum = 0;
  for (int k = roughness_->smallest_octave(); k <= roughness_->largest_octave(); ++k) {
    const double part = share(k, layers);
    sum += part * part * roughness_->mean_square_m2(k, diameter_m);
  }
  return std::sqrt(sum);
}

Vec3 CraterSurvey::on_rim(const Crater& crater, double angle) {
  const EastNorthUp axes = local_axes(crater.centre);
  // The field's distances are chords.
  const double away = 2 * std::asin(crater.diameter_m / 4 / kMoonRadius_m);
  return std::cos(away) * axes.up + std::sin(away) * (std::cos(angle) * axes.north + std::sin(angle) * axes.east);
}

}  // namespace selenograph::dem
