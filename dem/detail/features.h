// The craters of a detail that the terrain shows: ground truth for crater detectors.
//
// The detail's law defines the craters; the DEM's posts determine which of them the terrain shows (detail.h), for each
// crater by the posts at its centre. A crater across the border of the data is cut off there, and one across the band
// between layers (layered_posts.h) ends within it: rim_share gives the part that is left.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/catalogue/catalogue.h"
#include "dem/detail/crater_field.h"
#include "dem/detail/crater_visibility.h"
#include "dem/terrain/terrain.h"

namespace selenograph::dem {

struct CraterFeature {
  Crater crater;
  const Crater& member() const { return crater; }
  int octave = 0;
  Geographic place;  // of the centre; height of the terrain without detail
  // Share of its rim that the terrain shows: not where posts are finer or missing, nor where younger craters of its
  // octave change it by more than a quarter of its depth.
  double rim_share = 0;
  // The remaining part of the crater's depth (means_taken.h), weighted by its layer's share at its centre.
  double depth_m = 0;
  double visibility = 0;  // that depth over the roughness of the ground that is shown there (crater_visibility.h)
  double depth_over_diameter() const { return depth_m / crater.diameter_m; }
};

// The part of a crater that younger ones of its octave have left.
struct CraterRemains {
  static constexpr int kRimPoints = 16;
  std::array<bool, kRimPoints> rim{};  // points from north to east: changed by no more than a quarter of the depth
  double floor = 1;                    // share of the floor's depth
  bool any() const {
    return floor > 0.5 || std::any_of(rim.begin(), rim.end(), [](bool left) { return left; });
  }
};
// `candidates`: craters of its octave, at least all that reach its rim; it may be one of them.
CraterRemains remains_of(const CraterField& field, const Crater& crater, std::span<const Crater> candidates);

// Expected number of craters in a region by the law, or of those that have formed if that is fewer, before the terrain
// is considered.
double expected_craters(const CraterField& field, const Footprint& region, double smallest_m);

// Thread-safe: const functions may be called concurrently.
class CraterSurvey {
 public:
  // The terrain must have detail and outlive this object; `roughness` is of that detail.
  CraterSurvey(const Terrain& terrain, std::shared_ptr<const CraterRoughness> roughness);

  // Craters with their centre in a region (borders included), on all cores of the caller's arena, as deep as
  // `least_depth` of their diameter. Largest first. `east_deg` may exceed 180.
  std::vector<CraterFeature> within(const Footprint& region, double smallest_m, double least_depth,
                                    const StopToken& stop) const;
  // Appends the craters of an octave with their centre in a box that are `wanted`, in no particular order. Those that
  // the terrain does not show are left out: whose centre has finer posts or none, and whose floor and rim younger
  // craters of their octave replaced. The box should be some of the octave's diameters wide.
  void within(int octave, const Footprint& box, double least_depth, const std::function<bool(const Crater&)>& wanted,
              std::vector<CraterFeature>& out, const StopToken& stop) const;
  // Such a box's side over the octave's smallest diameter.
  static constexpr double kBoxDiameters = 32;

  const CraterField& field() const { return field_; }
  // Point of the rim at an angle about the centre, from north to east; a unit vector.
  static Vec3 on_rim(const Crater& crater, double angle);

 private:
  // A part of the region, for one octave.
  struct Piece {
    int octave;
    Footprint box;
  };
  std::vector<Piece> pieces(const Footprint& region, double smallest_m, const StopToken& stop) const;
  void add_if_shown(const Crater& crater, int octave, double least_depth, std::span<const Crater> candidates,
                    std::vector<CraterFeature>& out, const StopToken& stop) const;
  // Layers whose detail is shown at a place.
  std::vector<DetailOfPosts> layers_at(const Geographic& place) const;
  static double share(int octave, std::span<const DetailOfPosts> layers);
  bool shows(int octave, const Geographic& place) const { return share(octave, layers_at(place)) > 0.5; }
  double roughness_m(double diameter_m, std::span<const DetailOfPosts> layers) const;

  const Terrain& plain_;
  const Terrain& detailed_;
  const CraterField& field_;
  std::shared_ptr<const CraterRoughness> roughness_;
};

}  // namespace selenograph::dem
