// Ground with albedo or temperature from maps: the map's mean over each pixel's footprint, and the radiance.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "dem/value_maps/value_map.h"
#include "engine/camera/packet_rays.h"
#include "engine/camera/row_views.h"
#include "engine/frame/request.h"
#include "engine/radiometry/footprint_lanes.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// B(T) tau in the frame's band as a function of temperature: SENSOR++ eq. (3) without the factor 1 - rho. The table
// interpolates its logarithm over 1 / T, which is nearly straight: relative error 8e-5 in a band, 1.5e-4 over all
// wavelengths (tests/unit/mapped_surface_test.cpp).
class EmissionTable {
 public:
  explicit EmissionTable(const FrameRequest& request);
  double operator()(double temperature_k) const;  // W m-2 sr-1; 0 below 5 K

 private:
  std::vector<double> inverse_k_, log_;
};

// Sampler of a map, and the factor from its values to rho, Hapke's w, the ratio to the mean Moon, or kelvin.
struct ScaledMap {
  dem::ValueMap::Sampler map;
  double scale = 1;
};

// Albedo in the words of a reflectance: rho, w of Hapke, or for `moon` the ratio to the mean Moon. `constant`: its own;
// `largest`: that of a surface which reflects no more light than arrives.
struct Albedo {
  explicit Albedo(const Reflectance& reflectance);
  double constant, largest;
  bool is_w;  // it replaces w of Hapke; otherwise the reflectance is proportional to it
};

// The albedo maps of a request with their factors. Maps of I/F become rho. For `moon` they become ratios to the map's
// own mean over the near side, so that the disc stays the Moon's, or to the preset's I/F if the map has no such mean.
class AlbedoMaps {
 public:
  explicit AlbedoMaps(const FrameRequest& request);

  // Returns samplers for one thread. `stop` must outlive them.
  std::vector<ScaledMap> sampled(const StopToken& stop) const;
  double fallback() const { return albedo_.constant; }  // value where no map has one
  double max_value() const { return albedo_.largest; }

 private:
  std::vector<std::shared_ptr<const dem::ValueMap>> maps_;
  std::vector<double> scales_;
  Albedo albedo_;
};

// Computes albedo and emission of packets from a request's maps.
class MappedSurface {
 public:
  // `request` and `views` must outlive this object.
  MappedSurface(const FrameRequest& request, const RowViews& views);

  // State of one task. Its stop token must outlive it.
  struct Sampler {
    std::vector<ScaledMap> albedo, temperature;
    ReferencePositions references;
  };
  Sampler sampler(const StopToken& stop) const;

  // Returns true if radiance without the Sun varies over the ground.
  bool emits() const { return emission_ != nullptr; }
  // Sets, in each lane that hits, rho or Hapke's w and, if emits(), the radiance without the Sun, W m-2 sr-1. Throws
  // ImpossibleRequest if an albedo map has a value above the largest reflectance. `rows`: of the packet, if rows
  // have their own views.
  void sample(const SurfacePoints& points, const Rays& rays, Sampler& sampler, double* albedo, float* base,
              const PacketRows& rows = {}) const;

 private:
  // Differences of the direction from one sample's ray to the next.
  struct Steps {
    Vec3 right, down;
    // A fisheye's rays are unit vectors: its boresight, and the angle between adjacent samples at it.
    std::optional<Vec3> fisheye_boresight{};
    double angle = 0;
  };
  Steps steps_of(const View& view) const;
  static dem::ValueMap::Footprint2 footprint(const Steps& steps, const SurfacePoints& points, int lane,
                                             const Vec3& direction);
  void footprints(const SurfacePoints& points, const Rays& rays, const PacketRows& rows, ReferencePositions& references,
                  FootprintLanes& out) const;

  const FrameRequest& request_;
  const RowViews& views_;
  AlbedoMaps albedo_;
  double path_w_m2_sr_;
  std::unique_ptr<const EmissionTable> emission_;
  Steps steps_;  // steps of the reference view
};

// Splits a footprint among the maps: calls visit(value, share of the footprint) for the part that each map covers
// first, and with `fallback` for the rest.
template <typename Visit>
void visit_coverage(std::vector<ScaledMap>& maps, const dem::ValueMap::Footprint2& footprint, double fallback,
                    Visit&& visit) {
  double left = 1;
  for (ScaledMap& map : maps) {
    const auto [value, coverage] = map.map.mean(footprint);
    if (!(coverage > 0)) continue;
    visit(value * map.scale, left * coverage);
    left *= 1 - coverage;
    if (!(left > 1e-6)) return;
  }
  visit(fallback, left);
}

}  // namespace selenograph::engine
