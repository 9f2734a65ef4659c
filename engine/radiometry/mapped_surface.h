// A ground whose albedo or temperature is a map: what the map says of each pixel's footprint, and the radiance of it.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "dem/value_map.h"
#include "engine/camera/row_views.h"
#include "engine/frame/request.h"
#include "engine/radiometry/brdf.h"
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

  // Per lane that hits, W m-2 sr-1: with the Sun, and what is left without it. Throws ImpossibleRequest where a map of
  // albedo says more than 1. `first_row`: of a square packet, where rows have views of their own.
  void radiances(const SurfacePoints& points, const Shading& shading, const Rays& rays, const float* lit,
                 Sampler& sampler, float* out, float* base, int first_row = 0) const;

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

  const FrameRequest& request_;
  const RowViews& views_;
  Brdf whole_;  // of rho = 1
  double direct_w_m2_, path_w_m2_sr_, most_rho_;
  std::unique_ptr<const EmissionTable> emission_;
  Steps steps_;  // of the reference view
};

// The first map that has a value decides; `fallback` where none has.
double first_value(std::vector<dem::ValueMap::Sampler>& maps, const dem::ValueMap::Footprint2& footprint,
                   double fallback);

}  // namespace selenograph::engine
