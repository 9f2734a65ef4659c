// What the engine is asked for and what it answers: trusted, resolved values only (checked by api/ on the way in).
//
// Frame MOON_ME, metres, double. Camera axes are OpenCV's: +x right, +y down, +z along the boresight; the centre of the
// top-left pixel is (0, 0). `camera_from_moon` rotates MOON_ME vectors into camera axes.
#pragma once

#include <Eigen/Geometry>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "dem/geodesy.h"
#include "engine/sensor_model.h"
#include "engine/spectrum.h"

namespace selenograph::dem {
class ValueMap;
}

namespace selenograph::engine {

class Atmosphere;
class ObjectMesh;

// Brown-Conrady (Brown 1966; OpenCV's coefficients): with r^2 = x^2 + y^2 on the plane z = 1,
//   x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
//   y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y
struct Distortion {
  double k1 = 0, k2 = 0, k3 = 0, p1 = 0, p2 = 0;
  bool none() const { return k1 == 0 && k2 == 0 && k3 == 0 && p1 == 0 && p2 == 0; }
};

struct Camera {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels
  Distortion distortion;
};

struct Pose {
  Vec3 position_m = Vec3::Zero();
  Eigen::Quaterniond camera_from_moon = Eigen::Quaterniond::Identity();  // unit
};

struct Sun {
  Vec3 direction = Vec3::UnitX();  // unit, from the Moon toward the Sun
  double distance_au = 1.0;
  double angular_radius_deg = 0.0;  // 0: a point Sun, hard shadows
  // u of the disc's brightness 1 - u (1 - mu), mu: cosine of the angle from the Sun's own vertical; 0: even. About 0.6
  // in the visible.
  double limb_darkening = 0.0;
};

enum class ReflectanceModel {
  lambert,          // rho / pi                                             paper eq. (4)
  lommel_seeliger,  // rho / (2 pi) / (mu0 + mu)                            paper eq. (10)
  lunar,            // w * Lommel-Seeliger + (1 - w) * Lambert              paper 3.1
  blinn_phong,      // normalised by its exponent                           paper eq. (11)
  lunar_lambert,    // rho / pi (2 L / (mu0 + mu) + 1 - L)                  McEwen 1991
  hapke             // with the opposition surge and macroscopic roughness  Hapke 1984
};

// Of particles, p(g): sums to 4 pi over all directions.
enum class PhaseFunction {
  legendre,                 // 1 + b cos g + c (3 cos^2 g - 1) / 2
  double_henyey_greenstein  // a lobe back to the Sun of weight (1 + c) / 2 and one forward of (1 - c) / 2, both of
                            // width b
};

// Defaults: the whole Moon in the visible, Helfenstein & Veverka (Icarus 72, 342, 1987), table II, whose S(0) = 0.71 is
// b0 w p(0).
struct HapkeParameters {
  double w = 0.21;   // single-scattering albedo
  double b0 = 2.01;  // amplitude and
  double h = 0.07;   // angular width of the opposition surge
  PhaseFunction phase_function = PhaseFunction::legendre;
  double b = 0.29, c = 0.39;
  double theta_bar_deg = 20;  // mean slope of the roughness that the mesh doesn't resolve
};

struct Reflectance {
  ReflectanceModel model = ReflectanceModel::lunar;
  double lommel_seeliger_weight = 1.0;  // of lunar
  double rho = 0.12;                    // of all but hapke
  double shininess = 100;               // p of blinn_phong
  // L of lunar_lambert. Empty: 1 - 0.019 g + 0.242e-3 g^2 - 1.46e-6 g^3, not below 0, g: phase in degrees (McEwen, LPSC
  // XXVII, 841, 1996), which is the Moon's.
  std::optional<double> limb_darkening{};
  HapkeParameters hapke{};
};

// What a surface is made of.
struct Material {
  Reflectance reflectance;
  double temperature_k = 0;  // 0: nothing is emitted
};

// A triangle mesh that isn't terrain. Both of its sides are surface. It throws shadows and receives them.
struct SceneObject {
  std::shared_ptr<const ObjectMesh> mesh;
  Vec3 position_m = Vec3::Zero();                                        // of the mesh's origin
  Eigen::Quaterniond moon_from_object = Eigen::Quaterniond::Identity();  // unit; the mesh's axes are its file's
  double scale = 1;                                                      // metres per unit of the file
  std::vector<Material> materials;                                       // one for each of the mesh's parts
};

struct Accuracy {
  // Bound, in pixels, on the projected vertical error of the mesh; post spacing is kept below twice this many pixels.
  // 0: the finest posts everywhere.
  double max_error_px = 0.5;
  int samples_per_pixel = 1;  // radiance and image are means over a regular sub-pixel grid; must be a square number
  // Aim, in pixels, for how far a shadow's edge on level ground is displaced by the mesh's error: vertical error over
  // the tangent of the Sun's elevation. Where not even this much more terrain fits, it gives way: the frame reports
  // what was reached.
  double max_shadow_error_px = kDefaultShadowError_px;
  static constexpr double kDefaultShadowError_px = 16;
};

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

// Products, in the order of the contract's table. Values are bits of a set.
enum Product : std::uint32_t {
  kImage = 1u << 0,
  kRadiance = 1u << 1,
  kDepth = 1u << 2,
  kRange = 1u << 3,
  kPosition = 1u << 4,
  kGeodetic = 1u << 5,
  kNormal = 1u << 6,
  kAngles = 1u << 7,
  kLit = 1u << 8,
  kGsd = 1u << 9,
  kSource = 1u << 10,
  kObjectId = 1u << 11,
};
using ProductSet = std::uint32_t;

struct FrameRequest {
  Camera camera;
  Pose pose;
  Sun sun;
  Reflectance reflectance;
  std::optional<Band> band;  // that radiance is integrated over; empty: all wavelengths
  double temperature_k = 0;  // of the surface; 0: nothing is emitted
  // Of the ground: rho (not of hapke, which has none) and temperature in K. The first that has a value at a place
  // decides; where none has, the numbers above.
  std::vector<std::shared_ptr<const dem::ValueMap>> albedo_maps, temperature_maps;
  std::shared_ptr<const Atmosphere> atmosphere;  // null: none
  std::vector<SceneObject> objects;
  bool terrain = true;  // false: the objects are alone, without the Moon
  Accuracy accuracy;
  ImageSettings image;
  std::optional<SensorModel> sensor;  // that makes the image, of the band; empty: ImageSettings alone
  Visibility visibility = Visibility::automatic;
  ProductSet products = kRadiance;
};

// Of the image's numbers as they are stored: 8 or 16.
inline int image_bits(const FrameRequest& request) {
  return (request.sensor ? request.sensor->detector.bit_depth : request.image.bit_depth) <= 8 ? 8 : 16;
}

// Arrays of height x width (x components), row 0 on top; empty unless asked for. Missing values as in the contract.
struct FrameProducts {
  std::vector<std::uint16_t> image;  // 8-bit images too: the encoder narrows
  std::vector<float> radiance;       // W m-2 sr-1, band-integrated over the solar irradiance's band
  std::vector<double> depth, range;  // m
  std::vector<double> position;      // 3 per pixel, MOON_ME m
  std::vector<double> geodetic;      // 3 per pixel: lat_deg, lon_deg, height_m
  std::vector<float> normal;         // 3 per pixel, MOON_ME
  std::vector<float> angles;         // 3 per pixel: incidence, emission, phase, degrees
  std::vector<float> lit;
  std::vector<float> gsd;  // m
  std::vector<std::uint16_t> source;
  std::vector<std::uint16_t> object_id;  // index into FrameRequest::objects; 65535: terrain, or nothing
};

// A DEM tile that the frame stands on; `source` indexes the list of these.
struct SourceTile {
  std::string name;
  std::string path;
  std::uint64_t version = 0;  // hash of path, size and modification time
};

// At-sensor radiance is the sum of its components, SENSOR++ eq. (1): what all pixels of a frame share of them,
// integrated over its band.
struct RadianceTerms {
  double direct_w_m2 = 0;  // E_sun tau of eq. (2): times mu0 f_r s is L_dir
  // The others of eq. (1), W m-2 sr-1: of whatever is hit, in the Sun or not. Empty: not asked for.
  std::optional<double> indirect, scattered, emitted, thermal_path;

  double base_w_m2_sr() const {
    return indirect.value_or(0) + scattered.value_or(0) + emitted.value_or(0) + thermal_path.value_or(0);
  }
  // "direct" and those that were evaluated.
  std::vector<std::string_view> names() const;
};

struct StageTimes {
  double select_ms = 0;      // level of detail, casters, block loading
  double build_ms = 0;       // acceleration structure; 0 when the scene was warm
  double visibility_ms = 0;  // what each pixel sees, refined, lit and shaded
  // Of that, by z-buffer: drawing triangles, refining and shading points, casting shadows. Rays do all at once.
  double draw_ms = 0, resolve_ms = 0, shadow_ms = 0;
  double sensor_ms = 0;
};

struct FrameReport {
  Visibility visibility = Visibility::raytrace;  // that the frame was made with
  double lod_error_px = 0, lod_error_m = 0;      // bounds on the mesh's error in view
  double shadow_error_px = 0;  // bound on the displacement of shadow edges on level ground; 0 without Sun
  double min_post_spacing_m = 0, max_post_spacing_m = 0;
  std::size_t triangles = 0;
  std::size_t scene_bytes = 0;                   // of the mesh and its acceleration structure
  double filled_fraction = 0;                    // of all pixels: on posts that were filled by interpolation
  double missing_fraction = 0;                   // of all pixels: look at the Moon where there is no data
  double hit_fraction = 0, object_fraction = 0;  // of all pixels: see anything; see an object
  RadianceTerms radiance;                        // of the terrain in frames with radiance or image
  bool emits_elsewhere = false;                  // an object's material does, or the ground by a map of temperatures
  double full_scale_radiance_w_m2_sr = 0;        // that `image` was made with; 0 without image
  int margin_px = 0;             // rendered around the image for what spreads into it; shares of pixels count it
  double captured_fraction = 1;  // of a point's light, within the point spread's kernel
  std::vector<SourceTile> sources;
  std::vector<std::string> warnings;  // e.g. a corrupt tile replaced by the layer below
};

struct Frame {
  FrameProducts products;
  FrameReport report;
  StageTimes times;
};

// Polled between pixel tiles and between blocks being loaded; throws selenograph::Cancelled once it is time.
class StopToken {
 public:
  using Clock = std::chrono::steady_clock;
  StopToken() = default;  // never stops
  explicit StopToken(Clock::time_point deadline) : deadline_(deadline) {}
  StopToken(Clock::time_point deadline, const std::atomic<bool>* abandoned)
      : deadline_(deadline), abandoned_(abandoned) {}
  bool stopped() const {
    return (abandoned_ && abandoned_->load(std::memory_order_relaxed)) ||
           (deadline_ != Clock::time_point::max() && Clock::now() >= deadline_);
  }

 private:
  Clock::time_point deadline_ = Clock::time_point::max();
  const std::atomic<bool>* abandoned_ = nullptr;
};

// POST /v1/rays.
struct Ray {
  Vec3 origin_m;
  Vec3 direction;  // unit
};
struct RayHit {
  bool hit = false;
  double range_m = std::numeric_limits<double>::quiet_NaN();
  Vec3 position_m = Vec3::Zero();
  Vec3 normal = Vec3::Zero();
  double lit = 0;  // meaningful when a Sun was given
};

// POST /v1/project.
struct LandmarkQuery {
  double lat_deg = 0, lon_deg = 0;
  std::optional<double> height_m;  // empty: on the terrain
};
struct Landmark {
  double x_px = 0, y_px = 0;  // NaN behind the camera
  double range_m = 0;
  double height_m = 0;  // NaN: no data there
  bool in_frame = false, visible = false;
  double lit = 0;
};

}  // namespace selenograph::engine
