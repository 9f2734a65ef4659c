// Grounds by maps, over a smooth sphere: the same equations with the map's numbers in them.
#include "engine/radiometry/mapped_surface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "dem/gdal/geotiff_writer.h"
#include "engine/radiometry/atmosphere.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/moon.h"
#include "engine/radiometry/radiometry.h"
#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

TEST(Emission, TheTableHoldsPlancksLaw) {
  const auto atmosphere = std::make_shared<const Atmosphere>(
      std::vector<AtmosphereRow>{{5, 0.2, 10, 0, 0, 0}, {9, 0.9, 5, 0, 0, 0}, {15, 0.7, 1, 0, 0, 0}});
  for (int kind = 0; kind < 4; ++kind) {
    FrameRequest request;
    if (kind > 0) request.band.emplace(kind == 1 ? 10.0 : 9.0, kind == 1 ? 1.0 : 7.0);
    if (kind == 3) request.atmosphere = atmosphere;
    const EmissionTable table(request);
    for (double t = 20; t < 2000; t *= 1.0137) {
      Material black;
      black.reflectance.rho = 0, black.temperature_k = t;
      const double exact = *radiance_terms(request, black).emitted;
      if (exact < 1e-15) continue;
      // All wavelengths together bend the most: T^4 isn't straight over 1 / T.
      ASSERT_NEAR(table(t), exact, (kind == 0 ? 1.5e-4 : 8e-5) * exact) << kind << " " << t;
    }
    EXPECT_EQ(table(0), 0);
    EXPECT_EQ(table(std::nan("")), 0);
  }
}

// A place's reference is the same whatever was asked before, and near; not so near at poles only where it is the place.
TEST(ReferencePositions, FollowFromThePlaceAlone) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> lat(-90, 90), lon(-180, 180), off(-4000, 4000);
  ReferencePositions remembered;
  const auto lon_of = [](const ReferencePosition& near) { return std::pair(near.lat_deg, near.lon_deg); };
  for (int i = 0; i < 2000; ++i) {
    const Vec3 middle = to_cartesian({lat(random), lon(random), 0});
    for (int k = 0; k < 20; ++k) {
      const Vec3 place = middle + Vec3(off(random), off(random), off(random));
      const ReferencePosition& near = remembered.of(place);
      ASSERT_EQ(lon_of(near), lon_of(ReferencePositions().of(place)));
      const Geographic exact = to_geographic(place);
      ASSERT_NEAR(near.lat_deg, exact.lat_deg, 0.12);
      ASSERT_NEAR(near.lon_deg, exact.lon_deg, 0.5);
    }
  }
}

class MappedGround : public ::testing::Test {
 protected:
  static constexpr double kLat = 20, kLon = 30;
  static double rho(double lat) { return 0.1 + 0.05 * (lat - kLat); }
  static double kelvin(double lon) { return 250 + 40 * (lon - kLon); }

  static void SetUpTestSuite() {
    folder_ = new test::TemporaryFolder;
    test::write_global_tile(*folder_ / "dem", 2, [](double, double) { return 0.0; });
    renderer_ = new Renderer(test::open_terrain(*folder_ / "dem"), RendererOptions{2, std::size_t{256} << 20});
    albedo_ = map("albedo.tif", [](double lat, double) { return rho(lat); });
    kelvin_ = map("kelvin.tif", [](double, double lon) { return kelvin(lon); });
  }
  static void TearDownTestSuite() {
    albedo_.reset(), kelvin_.reset();
    delete renderer_;
    delete folder_;
  }

  // Two degrees around the place.
  static std::shared_ptr<const dem::ValueMap> map(const std::string& name,
                                                  const std::function<double(double, double)>& value,
                                                  const std::optional<dem::RadianceFactor>& factor = {}) {
    constexpr int kSide = 400;
    std::vector<float> values;
    const double step = 2.0 / kSide, north = kLat + 1 - step / 2, west = kLon - 1 + step / 2;
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) values.push_back(static_cast<float>(value(north - y * step, west + x * step)));
    dem::write_geotiff(*folder_ / name, {north, west, step, step, kSide, kSide}, values, "value");
    dem::ValueMapOptions options;
    options.path = *folder_ / name, options.radiance_factor = factor;
    return std::make_shared<const dem::ValueMap>(options, dem::make_value_map_tiles(std::size_t{128} << 20));
  }

  FrameRequest request(Visibility visibility) const {
    FrameRequest r;
    r.camera = test::square_camera(48, 30);
    const Vec3 eye = to_cartesian({kLat - 0.4, kLon, 60000});
    r.pose = test::looking(eye, to_cartesian({kLat, kLon, 0}) - eye, local_axes(eye).north);
    r.sun.direction = test::local_sun(kLat, kLon, 70, 35);
    r.visibility = visibility;
    r.products = kRadiance | kGeodetic | kAngles | kLit;
    return r;
  }

  // compare(lat, lon, mu0, mu, cos phase, radiance) for each pixel.
  template <typename Compare>
  void each(const FrameRequest& request, const Compare& compare) const {
    const FrameProducts p = renderer_->render(request).products;
    for (std::size_t i = 0; i < p.radiance.size(); ++i) {
      const auto cosine = [&](std::size_t k) {
        return std::cos(static_cast<double>(p.angles[3 * i + k]) * test::kDegree);
      };
      compare(p.geodetic[3 * i], p.geodetic[3 * i + 1], cosine(0), cosine(1), cosine(2),
              static_cast<double>(p.radiance[i]));
    }
  }

  static inline test::TemporaryFolder* folder_ = nullptr;
  static inline Renderer* renderer_ = nullptr;
  static inline std::shared_ptr<const dem::ValueMap> albedo_, kelvin_;
};

TEST_F(MappedGround, RadianceIsOfTheMapsAlbedo) {
  for (const Visibility visibility : {Visibility::zbuffer, Visibility::raytrace})
    for (const ReflectanceModel model :
         {ReflectanceModel::lambert, ReflectanceModel::lommel_seeliger, ReflectanceModel::blinn_phong,
          ReflectanceModel::lunar_lambert, ReflectanceModel::hapke}) {
      FrameRequest r = request(visibility);
      r.reflectance.model = model;
      if (model == ReflectanceModel::lommel_seeliger) r.reflectance.phase = PhaseLaw::rolo;
      r.albedo_maps = {albedo_};
      each(r, [&](double lat, double, double mu0, double mu, double cos_phase, double radiance) {
        Reflectance here = r.reflectance;
        here.rho = here.hapke.w = rho(lat);
        // Angles are float32.
        const double expected = 1361 * Brdf(here).times_mu0(mu0, mu, cos_phase);
        ASSERT_NEAR(radiance, expected, 3e-5 * expected);
      });
    }
}

// Maps of I/F become rho, whatever the model; with `moon` ratios to the mean Moon at the map's wavelength.
TEST_F(MappedGround, RadianceFactorsBecomeAlbedo) {
  const dem::RadianceFactor at{60, 0, 60, 0.665};
  const auto cosine = [](double degrees) { return std::cos(degrees * test::kDegree); };
  for (const ReflectanceModel model : {ReflectanceModel::lambert, ReflectanceModel::lommel_seeliger,
                                       ReflectanceModel::lunar_lambert, ReflectanceModel::moon}) {
    FrameRequest r = request(Visibility::zbuffer);
    r.reflectance.model = model;
    r.band.emplace(0.8, 0.1);
    Reflectance whole = r.reflectance;
    whole.rho = 1;
    const Band there(at.wavelength_um, 1e-3);
    const double of_one = std::numbers::pi * Brdf(whole, &there).times_mu0(cosine(60), 1, cosine(60));
    r.albedo_maps = {map(
        "factor.tif", [&](double lat, double) { return of_one * rho(lat); }, at)};
    each(r, [&](double lat, double, double mu0, double mu, double cos_phase, double radiance) {
      const double expected =
          solar_irradiance_w_m2(*r.band) * rho(lat) * Brdf(whole, &*r.band).times_mu0(mu0, mu, cos_phase);
      ASSERT_NEAR(radiance, expected, 4e-5 * expected);
    });
  }
}

// A map of the near side is a ratio to its own mean there: its absolute scale does not count.
TEST_F(MappedGround, TheNearSideOfAMapIsTheMeanMoon) {
  constexpr int kColumns = 180, kRows = 90;
  std::vector<float> values;
  for (int i = 0; i < kColumns * kRows; ++i) values.push_back(0.07F);
  dem::write_geotiff(*folder_ / "moon.tif", {89, -179, 2, 2, kColumns, kRows}, values, "value");
  dem::ValueMapOptions options;
  options.path = *folder_ / "moon.tif", options.radiance_factor = dem::RadianceFactor{60, 0, 60, 0.665};
  const auto whole = std::make_shared<const dem::ValueMap>(options, dem::make_value_map_tiles(std::size_t{128} << 20));
  EXPECT_NEAR(near_side_mean(*whole, {}).value_or(0), 0.07, 1e-6);
  EXPECT_FALSE(near_side_mean(*albedo_, {}));
  FrameRequest r = request(Visibility::zbuffer);
  r.reflectance.model = ReflectanceModel::moon;
  const std::vector<float> plain = renderer_->render(r).products.radiance;
  r.albedo_maps = {whole};
  const std::vector<float> mapped = renderer_->render(r).products.radiance;
  for (std::size_t i = 0; i < plain.size(); ++i) ASSERT_NEAR(mapped[i], plain[i], 2e-6F * plain[i]);
}

TEST_F(MappedGround, TheGroundEmitsByItsTemperatureAndAlbedo) {
  for (const Visibility visibility : {Visibility::zbuffer, Visibility::raytrace})
    for (const double radius_deg : {0.0, 0.2666}) {
      FrameRequest r = request(visibility);
      r.band.emplace(10.0, 1.0);
      r.sun.direction = -r.sun.direction;  // night
      r.sun.angular_radius_deg = radius_deg;
      r.albedo_maps = {albedo_}, r.temperature_maps = {kelvin_};
      each(r, [&](double lat, double lon, double, double, double, double radiance) {
        const double expected = planck_w_m2_sr(*r.band, kelvin(lon)) * (1 - rho(lat));
        ASSERT_NEAR(radiance, expected, 1e-4 * expected);
      });
      EXPECT_TRUE(renderer_->render(r).report.emits_elsewhere);
    }
}

TEST_F(MappedGround, UsesTheNumberWhereNoMapHasAValue) {
  FrameRequest r = request(Visibility::zbuffer);
  r.reflectance.model = ReflectanceModel::lambert, r.reflectance.rho = 0.4;
  const auto half = map("half.tif", [](double lat, double) { return lat < kLat ? 0.9 : std::nan(""); });
  const auto east = map("east.tif", [](double, double lon) { return lon > kLon ? 0.6 : std::nan(""); });
  r.albedo_maps = {half, east};
  each(r, [&](double lat, double lon, double mu0, double, double, double radiance) {
    if (std::abs(lat - kLat) < 0.06 || std::abs(lon - kLon) < 0.06) return;
    const double albedo = lat < kLat ? 0.9 : lon > kLon ? 0.6 : 0.4;
    ASSERT_NEAR(radiance, 1361 * albedo / M_PI * mu0, 3e-5 * 1361);
  });
}

// Texels much finer than pixels: one sample per pixel sees their mean, not one of them.
TEST_F(MappedGround, AFineMapDoesNotAlias) {
  FrameRequest r = request(Visibility::zbuffer);
  r.reflectance.model = ReflectanceModel::lambert;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(0, 0.2);
  r.albedo_maps = {map("noise.tif", [&](double, double) { return any(random); })};
  r.camera = test::square_camera(48, 30);
  const Vec3 eye = to_cartesian({kLat, kLon, 60000});
  r.pose = test::looking(eye, -eye, local_axes(eye).north);
  // 670 m per pixel, 152 m per texel; 0.2 / sqrt(12) of one texel.
  double square = 0, sum = 0, n = 0;
  each(r, [&](double, double, double mu0, double, double, double radiance) {
    const double albedo = radiance / (1361 / M_PI * mu0);
    sum += albedo, square += albedo * albedo, ++n;
  });
  const double spread = std::sqrt(square / n - sum / n * sum / n);
  EXPECT_NEAR(sum / n, 0.1, 0.002);
  EXPECT_LT(spread, 0.2 / std::sqrt(12.0) / 4) << "a texel's spread over the root of texels per pixel, 19, at most";
  EXPECT_GT(spread, 0.2 / std::sqrt(12.0) / 12) << "nor blurred away";
}

}  // namespace
}  // namespace selenograph::engine
