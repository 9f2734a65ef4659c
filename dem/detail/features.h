// The craters of a detail that the terrain shows: ground truth for crater detectors.
//
// The detail's law defines the craters; the DEM's posts determine which of them the terrain shows (detail.h), for each
// crater by the posts at its centre. A crater across the border of the data is cut off there, and one across the band
// between layers (layered_posts.h) ends within it: rim_share gives the part that is left.
#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/detail/crater_field.h"
#include "dem/support/stop_token.h"
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
  double depth_m = 0;  // the crater's, weighted by its layer's share at its centre
};

// What younger craters of its octave have left of a crater.
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

// Expected number of craters in a region by the law, before the terrain is considered.
double expected_craters(const CraterField& field, const Footprint& region, double smallest_m);

// Thread-safe: const functions may be called concurrently.
class CraterSurvey {
 public:
  // The terrain must have detail and outlive this object.
  explicit CraterSurvey(const Terrain& terrain);

  // Craters with their centre in a region (borders included), on all cores of the caller's arena. Largest first.
  // `east_deg` may exceed 180.
  std::vector<CraterFeature> within(const Footprint& region, double smallest_m, const StopToken& stop) const;
  // Craters of an octave whose rim may touch a sphere around a place, as given by the field.
  void near(int octave, const Vec3& direction, double radius_m, std::vector<Crater>& out, const StopToken& stop) const;
  // Appends the crater to `out` if the terrain shows it: posts are neither finer nor missing at its centre, and younger
  // craters of its octave do not replace both its floor and its rim.
  void add_if_shown(const Crater& crater, int octave, std::vector<CraterFeature>& out, const StopToken& stop) const;

  const CraterField& field() const { return field_; }
  // Point of the rim at an angle about the centre, from north to east; a unit vector.
  static Vec3 on_rim(const Crater& crater, double angle);

 private:
  // A part of the region, for one octave.
  struct Piece {
    int octave;
    Footprint box;
  };
  std::vector<Piece> pieces(const Footprint& region, double smallest_m) const;
  void survey(const Piece& piece, double smallest_m, const StopToken& stop, std::vector<CraterFeature>& out) const;
  void add_if_shown(const Crater& crater, int octave, std::span<const Crater> candidates,
                    std::vector<CraterFeature>& out, const StopToken& stop) const;
  // Share of an octave at a place.
  double share(int octave, const Geographic& place) const;
  bool shows(int octave, const Geographic& place) const { return share(octave, place) > 0.5; }

  const Terrain& plain_;
  const Terrain& detailed_;
  const CraterField& field_;
};

}  // namespace selenograph::dem
