#include "dem/detail/features.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/detail/detail.h"
#include "dem/detail/footprints.h"
#include "dem/detail/mean_correction.h"
#include "dem/terrain/surface_place.h"

namespace selenograph::dem {
namespace {

using std::numbers::pi;

// Returns the crater's own height at a direction.
double height_m(const CraterField& field, const Crater& crater, const Vec3& direction) {
  const double radii = round_radii(crater, direction);
  return radii >= CraterShape::reach(crater.age) ? 0 : crater.scale * field.shape().height(radii, crater.age);
}

// Returns whether a layer's posts leave an octave to the detail.
bool has_octave(const DetailOfPosts& layer, int octave) { return octave < Detail::past_largest_octave(layer.level); }

// Returns the share of the older ground that a crater replaces at a direction.
double replaced(const Crater& crater, const Vec3& direction) {
  return CraterShape::replaced_at(round_radii(crater, direction), crater.age);
}

}  // namespace

// Applies younger craters in the order of their ages, each on the ground that the one before left, as Detail::add does.
CraterRemains remains_of(const CraterField& field, const Crater& crater, std::span<const Crater> candidates) {
  std::vector<Crater> younger;
  for (const Crater& candidate : candidates)
    if (formed_before(crater, candidate) &&
        (candidate.centre - crater.centre).norm() * kMoonRadius_m < candidate.reach_m() + crater.diameter_m / 2)
      younger.push_back(candidate);
  std::sort(younger.begin(), younger.end(), formed_before);
  CraterRemains remains;
  for (int i = 0; i < CraterRemains::kRimPoints; ++i) {
    const Vec3 rim_point = CraterSurvey::on_rim(crater, 2 * pi * i / CraterRemains::kRimPoints);
    const double own_m = height_m(field, crater, rim_point);
    double now_m = own_m;
    for (const Crater& later : younger)
      now_m = now_m * (1 - replaced(later, rim_point)) + height_m(field, later, rim_point);
    // The point is left if younger craters changed it by at most a quarter of the depth.
    remains.rim[static_cast<std::size_t>(i)] = std::abs(now_m - own_m) <= crater.depth_m / 4;
  }
  for (const Crater& later : younger) remains.floor *= 1 - replaced(later, crater.centre);
  return remains;
}

double expected_craters(const CraterField& field, const Footprint& region, double smallest_m) {
  return area_m2(region) * field.number_per_m2(smallest_m);
}

CraterSurvey::CraterSurvey(const Terrain& terrain, std::shared_ptr<const CraterRoughness> roughness)
    : plain_(terrain.plain()),
      detailed_(*terrain.detailed()),
      field_(detailed_.detail().craters()),
      roughness_(std::move(roughness)) {}

std::vector<CraterSurvey::OctaveBox> CraterSurvey::octave_boxes(const Footprint& region, double smallest_m,
                                                                const StopToken& stop) const {
  std::vector<OctaveBox> boxes;
  for (int k = std::max(field_.smallest_octave(), octave_of(smallest_m)); k <= field_.largest_octave(); ++k)
    for (const Footprint& box : cut(region, std::ldexp(kBoxDiameters, k), stop)) boxes.push_back({k, box});
  return boxes;
}

std::vector<CraterFeature> CraterSurvey::craters_in(const Footprint& region, double smallest_m, double min_depth,
                                                    const StopToken& stop) const {
  const std::vector<OctaveBox> boxes = octave_boxes(region, smallest_m, stop);
  const auto is_large = [&](const Crater& crater) { return crater.diameter_m >= smallest_m; };
  return largest_first(gathered_in_parallel<CraterFeature>(boxes.size(), 4, [&](std::size_t i, auto& found) {
    stop.check();
    craters_in(boxes[i].octave, boxes[i].box, min_depth, is_large, found, stop);
  }));
}

void CraterSurvey::craters_in(int octave, const Footprint& box, double min_depth,
                              const std::function<bool(const Crater&)>& is_requested, std::vector<CraterFeature>& out,
                              const StopToken& stop) const {
  // Find all craters that reach the rim of a crater with its centre in the box: they may replace it.
  const double largest_m = std::ldexp(2.0, octave);
  const double margin_m = (CraterShape::reach(CraterShape::kOldest) + 1) * largest_m / 2;
  const std::vector<Crater> candidates = field_.in_box(octave, around(box, margin_m), stop);
  for (const Crater& crater : candidates) {
    stop.check();
    if (crater.depth_m >= min_depth * crater.diameter_m && is_requested(crater) &&
        holds(box, to_geographic(crater.centre * kMoonRadius_m)))
      add_if_shown(crater, octave, min_depth, candidates, out, stop);
  }
}

// Appends a crater as a feature, unless finer posts show there instead of the detail, the mean correction leaves less
// than `min_depth` of it, the terrain has no data at its centre, or younger craters have replaced it.
void CraterSurvey::add_if_shown(const Crater& crater, int octave, double min_depth, std::span<const Crater> candidates,
                                std::vector<CraterFeature>& out, const StopToken& stop) const {
  CraterFeature feature{crater, octave, to_geographic(crater.centre * kMoonRadius_m), 0};
  Geographic& centre = feature.location;
  const std::vector<DetailOfPosts> layers = layers_at(centre);
  const double share = this->share(octave, layers);
  if (!(share > 0.5)) return;
  // Test this upper bound first: depth_left() is slow.
  if (share * crater.depth_m < min_depth * crater.diameter_m) return;
  for (const DetailOfPosts& layer : layers)
    if (has_octave(layer, octave)) feature.depth_m += layer.share * depth_left(crater, layer.level) * crater.depth_m;
  if (feature.depth_over_diameter() < min_depth) return;
  centre.height_m = plain_.height(centre.lat_deg, centre.lon_deg, stop).height_m;
  if (std::isnan(centre.height_m)) return;
  feature.visibility =
      std::min(feature.depth_m / roughness_m(crater, centre, layers, stop), CraterRoughness::kMaxVisibility);
  feature.brightness = 1 + share * detailed_.detail().brightness().at_rim(crater);
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

// Drops layers with posts as fine as the finest surface: DetailedTerrain adds no detail to them.
std::vector<DetailOfPosts> CraterSurvey::layers_at(const Geographic& position) const {
  const int level = finest_level_at(detailed_, position.lat_deg, position.lon_deg);
  std::vector<DetailOfPosts> layers = detailed_.detail_at(position.lat_deg, position.lon_deg);
  std::erase_if(layers, [&](const DetailOfPosts& layer) { return level <= layer.level; });
  return layers;
}

double CraterSurvey::share(int octave, std::span<const DetailOfPosts> layers) {
  double share = 0;
  for (const DetailOfPosts& layer : layers)
    if (has_octave(layer, octave)) share += layer.share;
  return share;
}

double CraterSurvey::roughness_m(const Crater& crater, const Geographic& centre, std::span<const DetailOfPosts> layers,
                                 const StopToken& stop) const {
  double relief_factor = 0;
  for (const DetailOfPosts& layer : layers)
    relief_factor += layer.share * detailed_.relief_factor(centre.lat_deg, centre.lon_deg, layer.level, stop);
  double sum = 0;
  for (int k = roughness_->smallest_octave(); k <= roughness_->largest_octave(); ++k) {
    const double octave_share = share(k, layers);
    sum += octave_share * octave_share * roughness_->mean_square_m2(k, crater.diameter_m, relief_factor);
  }
  return std::sqrt(sum);
}

Vec3 CraterSurvey::on_rim(const Crater& crater, double angle) {
  const EastNorthUp axes = local_axes(crater.centre);
  const double east = std::sin(angle), north = std::cos(angle);
  const double radius_m = crater.diameter_m / 2 * crater.outline.rim(east, north, CraterShape::reach(crater.age));
  // Convert the radius, a chord as all distances of CraterField, to the angle at the Moon's centre.
  const double arc = 2 * std::asin(radius_m / 2 / kMoonRadius_m);
  return std::cos(arc) * axes.up + std::sin(arc) * (north * axes.north + east * axes.east);
}

}  // namespace selenograph::dem
