// Request to the engine. api/ has checked and resolved all values. Frame MOON_ME, metres, double.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "engine/frame/accuracy.h"
#include "engine/frame/band.h"
#include "engine/frame/camera.h"
#include "engine/frame/indirect.h"
#include "engine/frame/objects.h"
#include "engine/frame/pose.h"
#include "engine/frame/products.h"
#include "engine/frame/rims.h"
#include "engine/frame/sensor_model.h"
#include "engine/frame/shutter.h"
#include "engine/frame/sky.h"
#include "engine/frame/sun.h"
#include "engine/frame/surface.h"
#include "engine/frame/truth.h"

namespace selenograph::dem {
class Detail;
class ValueMap;
}  // namespace selenograph::dem

namespace selenograph::engine {

class Atmosphere;

// Visibility algorithm, for camera rays and for shadows.
enum class Visibility {
  automatic,  // chosen by visibility_for()
  zbuffer,    // z-buffer and irregular shadow map
  raytrace    // Embree
};

// Conversion of radiance to digital numbers without a sensor model: DN = clamp(round(L / full_scale * (2^bits - 1))).
struct ImageSettings {
  int bit_depth = 8;                                  // 8 or 16
  std::optional<double> full_scale_radiance_w_m2_sr;  // fixed exposure; empty: automatic, see almost_brightest()
};

struct FrameRequest {
  Camera camera;
  Pose pose;
  std::optional<Shutter> shutter;  // rows exposed one after the other; empty: all at once
  Sun sun;
  IndirectLight indirect;  // for terrain with a Sun
  Reflectance reflectance;
  std::optional<Band> band;  // integration band of radiance; empty: all wavelengths
  double temperature_k = 0;  // surface temperature; 0: no thermal emission
  // Maps of the ground's rho (w for Hapke's model) and of its temperature in K. The first map with a value at a
  // position applies, otherwise the constants above.
  std::vector<std::shared_ptr<const dem::ValueMap>> albedo_maps, temperature_maps;
  std::shared_ptr<const Atmosphere> atmosphere;  // null: none
  std::vector<SceneObject> objects;
  std::shared_ptr<const dem::Detail> detail;  // terrain detail finer than the posts; null: none
  bool terrain = true;                        // false: objects only, without the Moon
  Accuracy accuracy;
  ImageSettings image;
  std::optional<SensorModel> sensor;  // sensor model of the image; empty: ImageSettings apply
  Visibility visibility = Visibility::automatic;
  ProductSet products = kRadiance;
  std::optional<RimOptions> craters;  // lists craters of the detail in view; empty: no
  std::optional<SkyOptions> sky;      // objects of the sky besides the Moon; empty: none
  std::optional<Pose> flow_to;        // pose of the camera for the second image of the product `flow`
  std::optional<TruthGrid> truth;     // subset of pixels for ground-truth products; empty: all
};

// Returns the band of radiance; null: all wavelengths.
inline const Band* band_of(const FrameRequest& request) { return request.band ? &*request.band : nullptr; }

// Ground-truth products, to which TruthGrid applies. With `craters`, kRock is an exception, because it labels the
// image.
inline constexpr ProductSet kTruth = ~static_cast<ProductSet>(kImage | kRadiance);

// Returns the stored bits of a digital number: 8 or 16.
inline int image_bits(const FrameRequest& request) {
  return (request.sensor ? request.sensor->detector.bit_depth : request.image.bit_depth) <= 8 ? 8 : 16;
}

}  // namespace selenograph::engine
