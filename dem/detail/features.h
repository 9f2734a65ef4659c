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
#include "dem/detail/detailed_terrain.h"

namespace selenograph::dem {

struct CraterFeature {
  Crater crater;
  const Crater& member() const { return crater; }
  int octave = 0;
  Geographic location;  // the centre; height of the terrain without detail
  // Share of its rim that the terrain shows, 0 to 1: not where posts are finer or missing, nor where younger craters of
  // its octave change it by more than a quarter of its depth.
  double rim_share = 0;
  // The remaining depth of the crater (mean_correction.h), weighted by its layer's share at its centre.
  double depth_m = 0;
  double visibility = 0;  // depth_m over the roughness of the ground that is shown there (crater_visibility.h)
  double brightness = 1;  // factor of the albedo at its rim, averaged over azimuths (crater_brightness.h)
  double depth_over_diameter() const { return depth_m / crater.diameter_m; }
};

// Rim and floor of a crater, as younger craters of its octave have left them.
struct CraterRemains {
  static constexpr int kRimPoints = 16;
  std::array<bool, kRimPoints> rim{};  // points from north to east: true if changed by at most a quarter of the depth
  double floor = 1;                    // share of the floor's depth that is left, 0 to 1
  bool any() const {
    return floor > 0.5 || std::any_of(rim.begin(), rim.end(), [](bool left) { return left; });
  }
};
// Returns the remains of a crater. `candidates`: craters of its octave, at least all that reach its rim; the crater may
// be one of them.
CraterRemains remains_of(const CraterField& field, const Crater& crater, std::span<const Crater> candidates);

// Returns the expected number of craters in a region by the law, or of those that have formed if that is fewer, before
// the terrain is considered.
double expected_craters(const CraterField& field, const Footprint& region, double smallest_m);

// Thread-safe: const functions may be called concurrently.
class CraterSurvey {
 public:
  // The terrain must have detail and outlive this object; `roughness` is of that detail.
  CraterSurvey(const Terrain& terrain, std::shared_ptr<const CraterRoughness> roughness);

  // Returns the craters with their centre in a region (borders included) whose depth is at least `min_depth` of their
  // diameter, largest first. Runs on all cores of the caller's arena. `east_deg` may exceed 180.
  std::vector<CraterFeature> craters_in(const Footprint& region, double smallest_m, double min_depth,
                                        const StopToken& stop) const;
  // Appends the craters of an octave with their centre in a box that pass `is_requested`, in no particular order. Omits
  // craters that the terrain does not show: their centre has finer posts or none, or younger craters of their octave
  // replaced their floor and rim. The box should be several of the octave's diameters wide.
  void craters_in(int octave, const Footprint& box, double min_depth,
                  const std::function<bool(const Crater&)>& is_requested, std::vector<CraterFeature>& out,
                  const StopToken& stop) const;
  // Recommended side of such a box over the octave's smallest diameter.
  static constexpr double kBoxDiameters = 32;

  const CraterField& field() const { return field_; }
  // Returns the point of the rim at an angle about the centre, from north to east, as a unit vector.
  static Vec3 on_rim(const Crater& crater, double angle);

 private:
  // A box of the region, to be searched for craters of one octave.
  struct OctaveBox {
    int octave;
    Footprint box;
  };
  std::vector<OctaveBox> octave_boxes(const Footprint& region, double smallest_m, const StopToken& stop) const;
  void add_if_shown(const Crater& crater, int octave, double min_depth, std::span<const Crater> candidates,
                    std::vector<CraterFeature>& out, const StopToken& stop) const;
  // Returns the layers whose detail is shown at a position, with their shares.
  std::vector<DetailOfPosts> layers_at(const Geographic& position) const;
  // Returns the summed share of the layers that leave an octave to the detail, 0 to 1.
  static double share(int octave, std::span<const DetailOfPosts> layers);
  bool shows(int octave, const Geographic& position) const { return share(octave, layers_at(position)) > 0.5; }
  double roughness_m(const Crater& crater, const Geographic& centre, std::span<const DetailOfPosts> layers,
                     const StopToken& stop) const;

  const PyramidTerrain& plain_;
  const DetailedTerrain& detailed_;
  const CraterField& field_;
  std::shared_ptr<const CraterRoughness> roughness_;
};

}  // namespace selenograph::dem
