// A ground whose albedo or temperature is a map: what the map says of each pixel's footprint, and the radiance of it.
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

// B(T) tau in the frame's band over all temperatures: SENSOR++ eq. (3) but for 1 - rho. Its logarithm is interpolated
// over 1 / T, along which it is nearly straight: to 8e-5 of itself in a band, 1.5e-4 over all wavelengths
// (tests/unit/mapped_surface_test.cpp).
class EmissionTable {
 public:
  explicit EmissionTable(const FrameRequest& request);
  double operator()(double temperature_k) const;  // W m-2 sr-1; 0 below 5 K

 private:
  std::vector<double> inverse_k_, log_;
};

class MappedSurface {
 public:
  // `request` and `views` outlive it.
  MappedSurface(const FrameRequest& request, const RowViews& views);

  // For one task; `stop` outlives it.
  struct Sampler {
    std::vector<dem::ValueMap::Sampler> albedo, temperature;
    const StopToken* stop = nullptr;
  };
  Sampler sampler(const StopToken& stop) const;

  // Whether the radiance without the Sun is another at every place.
  bool emits() const { return emission_ != nullptr; }
  // Per lane that hits: rho, or Hapke's w; and W m-2 sr-1 without the Sun. Throws ImpossibleRequest where a map of
  // albedo says more than 1. `first_row`: of a square packet, where rows have views of their own.
  void sample(const SurfacePoints& points, const Rays& rays, Sampler& sampler, double* albedo, float* base,
              int first_row = 0) const;

 private:
  // From one sample's ray to the next one's.
  struct Steps {
    Vec3 right, down;
    // Of a fisheye's rays, which are unit vectors: its boresight, and the angle from one sample to the next on it.
    std::optional<Vec3> fisheye_boresight{};
    double angle = 0;
  };
  Steps steps_of(const View& view) const;
  static dem::ValueMap::Footprint2 footprint(const Steps& steps, const SurfacePoints& points, int lane,
                                             const Vec3& direction);
  void footprints(const SurfacePoints& points, const Rays& rays, int first_row, FootprintLanes& out) const;

  const FrameRequest& request_;
  const RowViews& views_;
  double path_w_m2_sr_, fallback_, most_;
  std::unique_ptr<const EmissionTable> emission_;
  Steps steps_;  // of the reference view
};

// What a footprint is made of: of each of its parts the first map that has a value decides, `fallback` where none has.
// part(value, share of the footprint).
template <typename Part>
void parts_of(std::vector<dem::ValueMap::Sampler>& maps, const dem::ValueMap::Footprint2& footprint, double fallback,
              Part&& part) {
  double left = 1;
  for (dem::ValueMap::Sampler& map : maps) {
    const auto [value, coverage] = map.mean(footprint);
    if (!(coverage > 0)) continue;
    part(value, left * coverage);
    left *= 1 - coverage;
    if (!(left > 1e-6)) return;
  }
  part(fallback, left);
}

}  // namespace selenograph::engine
