#include "engine/verify/moon_disc.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "dem/grid/geodesy.h"
#include "engine/radiometry/disc_models.h"
#include "engine/radiometry/moon.h"
#include "engine/radiometry/phase_law.h"
#include "engine/radiometry/sato2014.h"
#include "engine/radiometry/spectrum.h"

namespace selenograph::engine {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDistance_m = 384.4e6;
constexpr double kPhases_deg[] = {2, 3, 5, 7, 10, 15, 20, 30, 40, 50, 60, 70, 80, 90, 97};
constexpr double kNarrow_um = 1e-3;

// A named reflectance model; `region`: the Sato et al. (2014) preset, if it is one.
struct Model {
  std::string name;
  Reflectance reflectance;
  std::optional<SatoRegion> region{};
};

std::vector<Model> models() {
  const auto moon = [](MoonGround ground) {
    Reflectance r{ReflectanceModel::moon};
    r.ground = ground;
    return r;
  };
  const auto with = [](ReflectanceModel model, PhaseLaw law) {
    Reflectance r{model};
    r.phase = law;
    return r;
  };
  const Reflectance hapke{ReflectanceModel::hapke};
  return {{"moon", moon(MoonGround::mean)},
          {"moon-mare", moon(MoonGround::mare)},
          {"moon-highlands", moon(MoonGround::highlands)},
          {"sato2014", hapke, SatoRegion::global},
          {"sato2014-mare", hapke, SatoRegion::mare},
          {"sato2014-highlands", hapke, SatoRegion::highlands},
          {"lommel_seeliger", with(ReflectanceModel::lommel_seeliger, PhaseLaw::none)},
          {"lommel_seeliger, allen", with(ReflectanceModel::lommel_seeliger, PhaseLaw::allen)},
          {"lommel_seeliger, rolo", with(ReflectanceModel::lommel_seeliger, PhaseLaw::rolo)},
          {"lunar_lambert, rolo", with(ReflectanceModel::lunar_lambert, PhaseLaw::rolo)},
          {"hapke", hapke}};
}

// Returns a model's BRDF in a narrow band at a wavelength.
Brdf brdf_of(const Model& model, double wavelength_um) {
  const Band band(wavelength_um, kNarrow_um);
  Reflectance reflectance = model.reflectance;
  if (model.region) reflectance.hapke = sato2014(*model.region, wavelength_um);
  return Brdf(reflectance, &band);
}

// Returns the bands of ROLO and LIME in ascending order.
std::vector<double> bands_um() {
  std::vector<double> bands(disc_bands_um(DiscModel::rolo).begin(), disc_bands_um(DiscModel::rolo).end());
  bands.insert(bands.end(), disc_bands_um(DiscModel::lime).begin(), disc_bands_um(DiscModel::lime).end());
  std::sort(bands.begin(), bands.end());
  return bands;
}

// Returns a row with the published models' reflectance at the same geometry, NaN where they are not valid.
DiscRow row_of(const std::string& preset, const std::string& ground, double wavelength_um, const DiscGeometry& at,
               double signed_phase_deg, double reflectance) {
  const double none = std::numeric_limits<double>::quiet_NaN(), g = at.phase_deg;
  return {preset,
          ground,
          wavelength_um,
          signed_phase_deg,
          reflectance,
          g >= kRoloFirst_deg && g <= kRoloLast_deg ? disc_reflectance_at(DiscModel::rolo, wavelength_um, at) : none,
          g <= kLimeLast_deg ? disc_reflectance_at(DiscModel::lime, wavelength_um, at) : none};
}

// Returns a frame of the whole Moon in the middle of the image, north up, seen along the prime meridian.
FrameRequest disc_request(const FrameRequest& surface, double wavelength_um, double sun_lon_deg, int size_px) {
  FrameRequest request = surface;
  request.camera = {};
  request.camera.width = request.camera.height = size_px;
  request.camera.cx = request.camera.cy = (size_px - 1) / 2.0;
  constexpr double kAcross = 1.02;
  request.camera.fx = request.camera.fy = size_px * kDistance_m / (2 * kAcross * kMoonRadius_m);
  request.pose = {};
  request.pose.position_m = {kDistance_m, 0, 0};
  Eigen::Matrix3d camera_from_moon;  // rows: right (east), down (south), boresight
  camera_from_moon << 0, 1, 0, 0, 0, -1, -1, 0, 0;
  request.pose.camera_from_moon = Eigen::Quaterniond(camera_from_moon);
  request.sun.direction = {std::cos(sun_lon_deg * kRadiansPerDegree), std::sin(sun_lon_deg * kRadiansPerDegree), 0};
  request.band = Band(wavelength_um, kNarrow_um);
  request.products = kRadiance;
  request.accuracy.samples_per_pixel = 4;
  return request;
}

}  // namespace

double sphere_reflectance(const Brdf& brdf, double phase_deg) {
  // Integrate over photometric longitude, from the terminator to the limb, and latitude. The camera is at longitude 0,
  // the Sun at g.
  constexpr int kLongitudes = 300, kLatitudes = 100;
  const double g = phase_deg * kRadiansPerDegree, first = g - kPi / 2, span = kPi - g, cos_phase = std::cos(g);
  double sum = 0;
  for (int j = 0; j < kLatitudes; ++j) {
    const double latitude = (j + 0.5) / kLatitudes * kPi / 2, cosine = std::cos(latitude);
    for (int i = 0; i < kLongitudes; ++i) {
      const double longitude = first + (i + 0.5) / kLongitudes * span;
      const double mu = cosine * std::cos(longitude), mu0 = cosine * std::cos(longitude - g);
      sum += brdf.times_mu0(mu0, mu, cos_phase) * mu * cosine;
    }
  }
  return sum * 2 * (kPi / 2 / kLatitudes) * (span / kLongitudes);
}

std::vector<DiscRow> discs_on_sphere() {
  std::vector<DiscRow> rows;
  for (const Model& model : models()) {
    const bool spectral = model.region || model.reflectance.model == ReflectanceModel::moon;
    std::vector<double> discs;  // by phase angle; the same in all bands unless spectral
    for (const double wavelength_um : bands_um()) {
      if (model.region && (wavelength_um < kSatoFirst_um || wavelength_um > kSatoLast_um)) continue;
      if (spectral) discs.clear();
      if (discs.empty()) {
        const Brdf brdf = brdf_of(model, wavelength_um);
        for (const double phase_deg : kPhases_deg) discs.push_back(sphere_reflectance(brdf, phase_deg));
      }
      for (std::size_t i = 0; i < discs.size(); ++i)
        rows.push_back(row_of(model.name, "sphere", wavelength_um, {kPhases_deg[i]}, kPhases_deg[i], discs[i]));
    }
  }
  return rows;
}

std::vector<DiscRow> discs_on_terrain(const Renderer& renderer, const FrameRequest& surface, int size_px) {
  constexpr double kBand_um = 0.675;
  std::vector<DiscRow> rows;
  for (const double phase_deg : {2.0, 5.0, 7.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0})
    for (const double side : {1.0, -1.0}) {
      const FrameRequest request = disc_request(surface, kBand_um, side * phase_deg, size_px);
      const Frame frame = renderer.render(request);
      double sum = 0;
      for (const float radiance : frame.products.radiance) sum += static_cast<double>(radiance);
      // Pixels of a camera with so narrow a view have the same solid angle to 1e-4.
      const double pixel_sr = 1 / (request.camera.fx * request.camera.fy);
      const double disc_sr = kPi * std::pow(kMoonRadius_m / kDistance_m, 2);
      const double reflectance = kPi * sum * pixel_sr / (disc_sr * solar_irradiance_w_m2(*request.band));
      rows.push_back(row_of("moon", "terrain", kBand_um, {phase_deg, side * phase_deg}, side * phase_deg, reflectance));
    }
  return rows;
}

std::vector<ReliefRow> relief_at(const Renderer& renderer, const FrameRequest& surface, const Geographic& center,
                                 double width_m, int size_px) {
  std::vector<ReliefRow> rows;
  const EastNorthUp local = local_axes(center.lat_deg, center.lon_deg);
  const Brdf brdf(surface.reflectance, band_of(surface));
  for (const double incidence_deg : {0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0}) {
    FrameRequest request = surface;
    request.camera = {};
    request.camera.width = request.camera.height = size_px;
    request.camera.cx = request.camera.cy = (size_px - 1) / 2.0;
    const double height_m = 20 * width_m;  // nearly parallel rays
    request.camera.fx = request.camera.fy = size_px * height_m / width_m;
    request.pose = {};
    const double ground_m = renderer.terrain().height(center.lat_deg, center.lon_deg, {}).height_m;
    request.pose.position_m = to_cartesian({center.lat_deg, center.lon_deg, ground_m + height_m});
    Eigen::Matrix3d camera_from_moon;
    camera_from_moon << local.east.transpose(), -local.north.transpose(), -local.up.transpose();
    request.pose.camera_from_moon = Eigen::Quaterniond(camera_from_moon);
    request.sun.direction = std::cos(incidence_deg * kRadiansPerDegree) * local.up -
                            std::sin(incidence_deg * kRadiansPerDegree) * local.east;
    request.products = kRadiance | kLit | kPosition;
    const Frame frame = renderer.render(request);
    double sum = 0, smooth = 0, shadowed = 0, pixels = 0;
    for (std::size_t i = 0; i < frame.products.radiance.size(); ++i) {
      const Vec3 point_m(frame.products.position[3 * i], frame.products.position[3 * i + 1],
                         frame.products.position[3 * i + 2]);
      if (!point_m.allFinite()) continue;
      const Vec3 up = point_m.normalized(), toward = (request.pose.position_m - point_m).normalized();
      const double mu0 = up.dot(request.sun.direction);
      sum += static_cast<double>(frame.products.radiance[i]);
      smooth += direct_radiance(brdf, frame.report.radiance.direct_w_m2, mu0, up.dot(toward),
                                toward.dot(request.sun.direction), 1);
      shadowed += frame.products.lit[i] > 0 ? 0 : 1;
      pixels += 1;
    }
    rows.push_back({incidence_deg, smooth > 0 ? sum / smooth : 0, pixels > 0 ? shadowed / pixels : 0,
                    frame.report.min_post_spacing_m});
  }
  return rows;
}

}  // namespace selenograph::engine
