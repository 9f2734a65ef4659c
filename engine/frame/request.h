// What the engine is asked for: trusted, resolved values only (checked by api/ on the way in). Frame MOON_ME, metres,
// double.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "engine/frame/accuracy.h"
#include "engine/frame/band.h"
#include "engine/frame/camera.h"
#include "engine/frame/objects.h"
#include "engine/frame/pose.h"
#include "engine/frame/products.h"
#include "engine/frame/sensor_model.h"
#include "engine/frame/shutter.h"
#include "engine/frame/sun.h"
#include "engine/frame/surface.h"
#include "engine/frame/truth.h"

namespace selenograph::dem {
class Detail;
class ValueMap;
}  // namespace selenograph::dem

namespace selenograph::engine {

class Atmosphere;

// How the engine finds what each pixel sees and whether the Sun reaches it.
enum class Visibility {
  automatic,  // by what the frame has: see visibility_for
  zbuffer,    // z-buffer and irregular shadow map
  raytrace    // Embree
};

// How radiance becomes digital numbers without a sensor's model: DN = clamp(round(L / full_scale * (2^bits - 1))).
struct ImageSettings {
  int bit_depth = 8;  // 8 or 16
  std::optional<double>
      full_scale_radiance_w_m2_sr;  // given exposure; automatic (largest radiance in the frame) if empty
};

struct FrameRequest {
  Camera camera;
  Pose pose;
  std::optional<Shutter> shutter;  // that exposes the rows one after the other; empty: all at once
  Sun sun;
  Reflectance reflectance;
  std::optional<Band> band;  // that radiance is integrated over; empty: all wavelengths
  double temperature_k = 0;  // of the surface; 0: nothing is emitted
  // Of the ground: rho (not of hapke, which has none) and temperature in K. The first that has a value at a place
  // decides; where none has, the numbers above.
  std::vector<std::shared_ptr<const dem::ValueMap>> albedo_maps, temperature_maps;
  std::shared_ptr<const Atmosphere> atmosphere;  // null: none
  std::vector<SceneObject> objects;
  std::shared_ptr<const dem::Detail> detail;  // of the terrain below its posts; null: none
  bool terrain = true;                        // false: the objects are alone, without the Moon
  Accuracy accuracy;
  ImageSettings image;
  std::optional<SensorModel> sensor;  // that makes the image, of the band; empty: ImageSettings alone
  Visibility visibility = Visibility::automatic;
  ProductSet products = kRadiance;
  std::optional<TruthGrid> truth;  // of products other than image and radiance; empty: of every pixel
};

// Products that TruthGrid is about.
inline constexpr ProductSet kTruth = ~static_cast<ProductSet>(kImage | kRadiance);

// Of the image's numbers as they are stored: 8 or 16.
inline int image_bits(const FrameRequest& request) {
  return (request.sensor ? request.sensor->detector.bit_depth : request.image.bit_depth) <= 8 ? 8 : 16;
}

}  // namespace selenograph::engine
