// Ground whose albedo or temperature is given by maps: the map's value over each pixel's footprint, and the radiance.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "dem/value_maps/value_map.h"
#include "engine/camera/row_views.h"
#include "engine/frame/request.h"
#include "engine/radiometry/footprint_lanes.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// B(T) tau in the frame's band as a function of temperature: SENSOR++ eq. (3) without the factor 1 - rho. Its logarithm
// is interpolated over 1 / T, where it is nearly straight: relative error 8e-5 in a band, 1.5e-4 over all wavelengths
// (tests/unit/mapped_surface_test.cpp).
class EmissionTable {
 public:
  explicit EmissionTable(const FrameRequest& request);
  double operator()(double temperature_k) const;  // W m-2 sr-1; 0 below 5 K

 private:
  std::vector<double> inverse_k_, log_;
};

// A map's sampler, and the factor from its values to rho, Hapke's w, the ratio to the mean Moon, or kelvin.
struct ScaledMap {
  dem::ValueMap::Sampler map;
  double scale = 1;
};

// The albedo maps of a request with their factors: maps of I/F become rho, or for `moon` ratios to the mean Moon: to
// the map's own mean over the near side, so that the disc stays the Moon's; to the preset's I/F if it has none.
class AlbedoMaps {
 public:
  explicit AlbedoMaps(const FrameRequest& request);

  // For one thread; `stop` must outlive it.
  std::vector<ScaledMap> sampled(const StopToken& stop) const;
  double fallback() const { return fallback_; }  // the value where no map has one
  double most() const { return most_; }          // the largest value of a reflectance

 private:
  std::vector<std::shared_ptr<const dem::ValueMap>> maps_;
  std::vector<double> scales_;
  double fallback_, most_;
};

class MappedSurface {
 public:
  // `request` and `views` must outlive this object.
  MappedSurface(const FrameRequest& request, const RowViews& views);

  // State of one task; the token that it was made with must outlive it.
  struct Sampler {
    std::vector<ScaledMap> albedo, temperature;
    NearPlaces near;
  };
  Sampler sampler(const StopToken& stop) const;

  // Whether radiance without the Sun varies from place to place.
  bool emits() const { return emission_ != nullptr; }
  // For each lane that hits: rho or Hapke's w, and, if that varies, the radiance without the Sun, W m-2 sr-1. Throws
  // ImpossibleRequest where an albedo map has a value above 1. `first_row`: of a square packet, when rows have their
  // own views.
  void sample(const SurfacePoints& points, const Rays& rays, Sampler& sampler, double* albedo, float* base,
              int first_row = 0) const;

 private:
  // Steps from one sample's ray to the next.
  struct Steps {
    Vec3 right, down;
    // For a fisheye, whose rays are unit vectors: its boresight, and the angle between adjacent samples there.
    std::optional<Vec3> fisheye_boresight{};
    double angle = 0;
  };
  Steps steps_of(const View& view) const;
  static dem::ValueMap::Footprint2 footprint(const Steps& steps, const SurfacePoints& points, int lane,
                                             const Vec3& direction);
  void footprints(const SurfacePoints& points, const Rays& rays, int first_row, NearPlaces& near,
                  FootprintLanes& out) const;

  const FrameRequest& request_;
  const RowViews& views_;
  AlbedoMaps albedo_;
  double path_w_m2_sr_;
  std::unique_ptr<const EmissionTable> emission_;
  Steps steps_;  // for the reference view
};

// Visits the parts of a footprint as part(value, share of the footprint): for each part the value of the first map that
// has one, `fallback` where none has.
template <typename Part>
void parts_of(std::vector<ScaledMap>& maps, const dem::ValueMap::Footprint2& footprint, double fallback, Part&& part) {
  double left = 1;
  for (ScaledMap& map : maps) {
    const auto [value, coverage] = map.map.mean(footprint);
    if (!(coverage > 0)) continue;
    part(value * map.scale, left * coverage);
    left *= 1 - coverage;
    if (!(left > 1e-6)) return;
  }
  part(fallback, left);
}

}  // namespace selenograph::engine
