// The craters of a detail that the terrain has: truth for what looks for craters.
//
// The detail's law says which craters there are, the DEM's posts which of them the terrain shows (detail.h). It is
// decided for each crater by the posts at its centre. A crater across the border of the data is cut by it, one across
// the band between layers (layered_posts.h) ends within it: its rim_share says so.
#pragma once

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
  Geographic place;  // of its centre; the height is that of the terrain without detail
  // Of its rim, what the terrain shows: not where posts are finer or missing, nor where other craters of its octave
  // change it by more than a quarter of its depth. (Of craters of one octave the deepest counts: they don't add up.)
  double rim_share = 0;
  double depth_m = 0;  // the crater's, as far as its layer's detail counts at its centre
};

// How many craters the law expects in a region, before the terrain is asked.
double expected_craters(const CraterField& field, const Footprint& region, double smallest_m);

// Const means safe to call concurrently.
class CraterSurvey {
 public:
  // The terrain has detail and outlives it.
  explicit CraterSurvey(const Terrain& terrain);

  // Those with their centre in a region, whose borders belong to it, in all cores of the caller's arena. The largest
  // come first. `east_deg` may exceed 180.
  std::vector<CraterFeature> within(const Footprint& region, double smallest_m, const StopToken& stop) const;
  // Those of an octave whose rim may meet a ball around a place on the sphere, as the field has them.
  void near(int octave, const Vec3& direction, double radius_m, std::vector<Crater>& out, const StopToken& stop) const;
  // Appended to `out` if the terrain shows it: neither where posts are finer or missing at its centre, nor where others
  // of its octave cover both its floor and its rim.
  void add_if_shown(const Crater& crater, int octave, std::vector<CraterFeature>& out, const StopToken& stop) const;

  const CraterField& field() const { return field_; }
  // An angle about the centre, from north to east; on the sphere, of unit length.
  static Vec3 on_rim(const Crater& crater, double angle);

 private:
  // A part of the region, of one octave.
  struct Piece {
    int octave;
    Footprint box;
  };
  std::vector<Piece> pieces(const Footprint& region, double smallest_m) const;
  void survey(const Piece& piece, double smallest_m, const StopToken& stop, std::vector<CraterFeature>& out) const;
  void add_if_shown(const Crater& crater, int octave, std::span<const Crater> candidates,
                    std::vector<CraterFeature>& out, const StopToken& stop) const;
  // How much of an octave there is.
  double share(int octave, const Geographic& place) const;
  bool shows(int octave, const Geographic& place) const { return share(octave, place) > 0.5; }
  double octave_height_m(double own_m, const Vec3& place, std::span<const Crater> others) const;

  const Terrain& plain_;
  const Terrain& detailed_;
  const CraterField& field_;
};

}  // namespace selenograph::dem
