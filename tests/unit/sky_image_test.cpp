// Stars and discs in frames: places, light, what hides them.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "engine/camera/view.h"
#include "engine/radiometry/solar_spectrum.h"
#include "engine/radiometry/spectrum.h"
#include "engine/sky/earth_figure.h"
#include "engine/sky/ephemeris.h"
#include "engine/sky/star_catalogue.h"
#include "tests/support/moon_without_relief.h"
#include "tests/support/queries.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

constexpr const char* kUtc = "2026-11-25T00:00:00Z";

class SkyOfAMoonWithoutRelief : public test::MoonWithoutRelief {
 protected:
  // Stars of V = 2 in a grid around a direction (MOON_ME), degrees apart.
  static std::shared_ptr<const StarCatalogue> grid_of_stars(const Vec3& middle, double apart_deg, int half) {
    const Vec3 d = moon_me_from_icrf(kUtc).transpose() * middle;
    const double ra = std::atan2(d.y(), d.x()) * kDegreesPerRadian, dec = std::asin(d.z()) * kDegreesPerRadian;
    std::vector<StarRow> rows;
    for (int j = -half; j <= half; ++j)
      for (int i = -half; i <= half; ++i) {
        const double at_dec = dec + j * apart_deg, at_ra = ra + i * apart_deg / std::cos(at_dec * kRadiansPerDegree);
        rows.push_back(
            {std::to_string(j) + "/" + std::to_string(i), std::fmod(at_ra + 360, 360), at_dec, 2000, 0, 0, 0, 2, 0.65});
      }
    return std::make_shared<const StarCatalogue>("grid", rows);
  }

  // From 2000 km above the Moon, away from it.
  static FrameRequest looking_up() {
    FrameRequest request = test::blank_request();
    request.visibility = Visibility::automatic;
    request.camera = test::square_camera(128, 20);
    const Vec3 place = to_cartesian({20, 30, 2e6});
    request.pose = test::looking(place, place + Vec3(2e5, 1e5, -3e5), Vec3::unit_z());
    request.sun.direction = Vec3::unit_x();
    request.band = Band(0.6, 0.1);
    request.sky.emplace();
    request.sky->utc = kUtc;
    request.sky->stars = grid_of_stars(View(request.camera, request.pose).middle(), 3, 2);
    return request;
  }

  static SensorModel noiseless() {
    SensorModel sensor;
    sensor.optics.f_number = 2;
    sensor.detector.pixel_pitch_um = 10, sensor.detector.quantum_efficiency = 0.5,
    sensor.detector.integration_time_s = 20;
    sensor.detector.photon_noise = false, sensor.detector.bit_depth = 16, sensor.detector.gain_e_dn = 0.5;
    return sensor;
  }

  struct Blob {
    double x_px, y_px, sum;
  };
  // Centroid and sum around a place.
  template <typename T>
  static Blob blob(const std::vector<T>& image, int width, double x_px, double y_px, int half) {
    Blob b{0, 0, 0};
    const int column = static_cast<int>(std::lround(x_px)), row = static_cast<int>(std::lround(y_px));
    for (int y = row - half; y <= row + half; ++y)
      for (int x = column - half; x <= column + half; ++x) {
        const auto value = static_cast<double>(image[static_cast<std::size_t>(y * width + x)]);
        b.x_px += value * x, b.y_px += value * y, b.sum += value;
      }
    b.x_px /= b.sum, b.y_px /= b.sum;
    return b;
  }
  // Irradiance of all of an image, each pixel by its solid angle.
  double irradiance(const FrameRequest& request) {
    const View view(request.camera, request.pose);
    const std::vector<float> radiance = renderer().render(request).products.radiance;
    double sum = 0;
    for (std::size_t i = 0; i < radiance.size(); ++i) {
      const auto x = static_cast<double>(i % static_cast<std::size_t>(request.camera.width)),
                 y = static_cast<double>(i / static_cast<std::size_t>(request.camera.width));
      if (!(radiance[i] > 0)) continue;
      const auto corner = [&](double dx, double dy) { return view.ray(x + dx, y + dy)->normalized(); };
      sum += static_cast<double>(radiance[i]) *
             (corner(0.5, 0.5) - corner(-0.5, -0.5)).cross(corner(-0.5, 0.5) - corner(0.5, -0.5)).norm() / 2;
    }
    return sum;
  }
  // The Earth or the Sun alone, from 5000 km toward it, so that it is right of and below the boresight by these angles.
  static FrameRequest looking_beside(SkyKind kind, const char* utc, const Camera& camera, double right_deg,
                                     double below_deg = 0) {
    FrameRequest request = looking_up();
    request.camera = camera;
    request.sky->stars.reset(), request.sky->utc = utc;
    (kind == SkyKind::sun ? request.sky->sun : request.sky->earth) = true;
    const Vec3 toward = kind == SkyKind::sun ? sun_at(utc).direction : earth_at(utc).direction;
    request.pose = test::looking(5e6 * toward, toward, Vec3::unit_z());
    const Quat beside(AngleAxis(right_deg * kRadiansPerDegree, Vec3::unit_y()) *
                      AngleAxis(-below_deg * kRadiansPerDegree, Vec3::unit_x()));
    request.pose.camera_from_moon = beside * request.pose.camera_from_moon;
    return request;
  }
  static bool well_inside(const SkyObject& o, const Camera& c, double margin) {
    return o.x_px > margin && o.y_px > margin && o.x_px < c.width - 1 - margin && o.y_px < c.height - 1 - margin;
  }
};

TEST_F(SkyOfAMoonWithoutRelief, StarsAreWhereTheListSaysThroughALens) {
  FrameRequest request = looking_up();
  request.camera.distortion = {-0.1, 0.02, 0, 0.001, -0.002};
  const View view(request.camera, request.pose);
  int compared = 0;
  const std::vector<float> radiance = renderer().render(request).products.radiance;
  for (const SkyObject& o : test::query_sky(renderer(), request)) {
    if (!well_inside(o, request.camera, 5)) continue;
    ++compared;
    const Blob b = blob(radiance, request.camera.width, o.x_px, o.y_px, 3);
    EXPECT_NEAR(b.x_px, o.x_px, 1e-4);
    EXPECT_NEAR(b.y_px, o.y_px, 1e-4);
    // The pixel's solid angle, from its corners.
    const auto corner = [&](double dx, double dy) { return view.ray(o.x_px + dx, o.y_px + dy)->normalized(); };
    const double sr = (corner(0.5, 0.5) - corner(-0.5, -0.5)).cross(corner(-0.5, 0.5) - corner(0.5, -0.5)).norm() / 2;
    EXPECT_NEAR(b.sum * sr / o.irradiance_w_m2, 1, 1e-3);
    EXPECT_LT((view.ray(o.x_px, o.y_px)->normalized() - o.direction).norm(), 1e-9);
  }
  EXPECT_GE(compared, 20);
}

// Electrons by hand: zero point, aperture, energy of a photon.
TEST_F(SkyOfAMoonWithoutRelief, SensorsCountStarsAtTheirPlaces) {
  for (const PointSpread::Model model :
       {PointSpread::Model::none, PointSpread::Model::gaussian, PointSpread::Model::airy}) {
    FrameRequest request = looking_up();
    request.band = Band(0.55, 0.01);
    request.sensor = noiseless();
    request.sensor->optics.point_spread.model = model, request.sensor->optics.point_spread.sigma_px = 0.8;
    // Wide enough for its pixels to sample it: of a narrower one the pixels' own centroid deviates, as in a camera.
    const bool airy = model == PointSpread::Model::airy;
    if (airy)
      request.sensor->optics.f_number = 32, request.sensor->detector.gain_e_dn = 0.01,
      request.sensor->detector.integration_time_s = 2000,
      request.sky->stars = grid_of_stars(View(request.camera, request.pose).middle(), 3, 0);
    request.products = kImage;
    const auto image = renderer().render(request).products.image;
    const Detector& d = request.sensor->detector;
    const double focal_m = request.camera.fx * d.pixel_pitch_um * 1e-6,
                 aperture_m = focal_m / request.sensor->optics.f_number;
    int compared = 0;
    for (const SkyObject& o : test::query_sky(renderer(), request)) {
      if (!well_inside(o, request.camera, 24)) continue;
      ++compared;
      const Blob b = blob(image, request.camera.width, o.x_px, o.y_px, airy ? 23 : 12);
      EXPECT_NEAR(b.x_px, o.x_px, 0.01) << static_cast<int>(model);
      EXPECT_NEAR(b.y_px, o.y_px, 0.01) << static_cast<int>(model);
      // Off the axis a detector of eqs. (8) and (9) has the aperture that gives a level field its level image.
      const double cosine = o.direction.dot(View(request.camera, request.pose).moon_from_camera().col(2));
      const double by_hand = 3.63e-8 * 0.01 * std::pow(10, -0.4 * 2) * std::numbers::pi / 4 * aperture_m * aperture_m /
                             std::pow(cosine, 3) * d.integration_time_s * d.quantum_efficiency * 0.55e-6 /
                             (kPlanck_j_s * kSpeedOfLight_m_s);
      ASSERT_TRUE(o.electrons);
      EXPECT_NEAR(*o.electrons / by_hand, 1, 0.005);
      EXPECT_NEAR(b.sum * d.gain_e_dn / by_hand, 1, 0.01) << static_cast<int>(model);
    }
    EXPECT_GE(compared, airy ? 1 : 9);
  }
}

TEST_F(SkyOfAMoonWithoutRelief, MotionSmearsStarsAndKeepsTheirLight) {
  FrameRequest request = looking_up();
  request.sensor = noiseless();
  request.sensor->optics.point_spread.model = PointSpread::Model::gaussian,
  request.sensor->optics.point_spread.sigma_px = 0.8;
  request.sensor->detector.gain_e_dn = 2;
  request.products = kImage;
  request.sky->stars = grid_of_stars(View(request.camera, request.pose).middle(), 3, 0);
  const auto still = renderer().render(request).products.image;
  request.sensor->motion.angular_rate_deg_s = {0, 0.05, 0};  // a degree: 6.3 pixels
  const Frame moving = renderer().render(request);
  const SkyObject star = test::query_sky(renderer(), request).at(0);
  const Blob before = blob(still, 128, star.x_px, star.y_px, 12),
             after = blob(moving.products.image, 128, star.x_px, star.y_px, 12);
  EXPECT_GT(moving.report.motion_samples, 5);
  EXPECT_NEAR(after.sum / before.sum, 1, 0.01);
  EXPECT_NEAR(after.x_px, star.x_px, 0.02);
  EXPECT_LT(*std::max_element(moving.products.image.begin(), moving.products.image.end()),
            *std::max_element(still.begin(), still.end()) / 2);
}

// A row of stars across the limb: the sphere's tangent decides.
TEST_F(SkyOfAMoonWithoutRelief, TheMoonHidesWhatIsBehindItsLimb) {
  FrameRequest request = looking_up();
  const Vec3 place = request.pose.position_m, down = -place.normalized(),
             across = down.cross(Vec3::unit_z()).normalized();
  const double limb = std::asin(kMoonRadius_m / place.norm());
  request.pose = test::looking(place, std::cos(limb) * down + std::sin(limb) * across, Vec3::unit_z());
  request.camera = test::square_camera(256, 1);
  request.sky->stars = grid_of_stars(View(request.camera, request.pose).middle(), 0.02, 20);
  const auto sky = test::query_sky(renderer(), request);
  const std::vector<float> radiance = renderer().render(request).products.radiance;
  int hidden = 0, seen = 0;
  for (const SkyObject& o : sky) {
    const double from_limb_m = std::sin(std::acos(o.direction.dot(down))) * place.norm() - kMoonRadius_m;
    if (std::abs(from_limb_m) < 1) continue;  // chords of the mesh
    EXPECT_EQ(o.hidden_by, from_limb_m < 0 ? HiddenBy::moon : HiddenBy::none) << from_limb_m;
    (from_limb_m < 0 ? hidden : seen)++;
  }
  EXPECT_GT(hidden, 100);
  EXPECT_GT(seen, 100);
}

// Its radius along a line of sight is between the polar and the equatorial one. Seen or not, it hides.
TEST_F(SkyOfAMoonWithoutRelief, TheEarthHidesWhatIsBehindIt) {
  FrameRequest request = looking_beside(SkyKind::earth, kUtc, test::square_camera(256, 3), 0.1);
  const SkyObject earth = test::query_sky(renderer(), request).at(0);
  EXPECT_EQ(earth.hidden_by, HiddenBy::none);
  request.sky->stars = grid_of_stars(earth.direction, 0.1, 12), request.sky->earth = false;
  const std::vector<float> radiance = renderer().render(request).products.radiance;
  int hidden = 0, seen = 0;
  for (const SkyObject& o : test::query_sky(renderer(), request)) {
    if (!well_inside(o, request.camera, 2)) continue;
    const double beside_m = std::sin(std::acos(o.direction.dot(earth.direction))) * *earth.distance_m;
    if (beside_m > 6.355e6 && beside_m < 6.38e6) continue;
    const bool covered = beside_m < 6.37e6;
    EXPECT_EQ(o.hidden_by, covered ? HiddenBy::earth : HiddenBy::none) << beside_m;
    EXPECT_EQ(blob(radiance, 256, o.x_px, o.y_px, 1).sum > 0, !covered) << beside_m;
    (covered ? hidden : seen)++;
  }
  EXPECT_GT(hidden, 150);
  EXPECT_GT(seen, 150);
}

// From behind the one and from behind the other, where both are before a star.
TEST_F(SkyOfAMoonWithoutRelief, TheNearerOfMoonAndEarthHides) {
  const Earth earth = earth_at(kUtc);
  for (const double toward_earth_m : {-5e6, earth.distance_m + 1e8}) {
    FrameRequest request = looking_beside(SkyKind::earth, kUtc, test::square_camera(128, 10), 0);
    const Vec3 ahead = toward_earth_m < 0 ? earth.direction : Vec3(-earth.direction);
    request.pose = test::looking(toward_earth_m * earth.direction, ahead, Vec3::unit_z());
    request.sky->stars = grid_of_stars(ahead, 1, 0);
    EXPECT_EQ(test::query_sky(renderer(), request).at(0).hidden_by,
              toward_earth_m < 0 ? HiddenBy::moon : HiddenBy::earth);
  }
}

// A uniform Sun behind a disc, by the area that two circles have in common; in pixels smaller and larger than the Sun.
TEST_F(SkyOfAMoonWithoutRelief, TheEarthCoversItsPartOfTheSun) {
  int partial = 0;
  for (const char* utc : {"2025-03-14T04:40:00Z", "2025-03-14T05:05:00Z", "2025-03-14T05:25:00Z",
                          "2025-03-14T05:45:00Z", "2025-03-14T06:59:00Z"})
    for (const double fov_deg : {2.0, 20.0, 120.0}) {
      FrameRequest request = looking_beside(SkyKind::sun, utc, test::square_camera(128, fov_deg), 0.003 * fov_deg);
      request.sun.limb_darkening = 0;
      const double seen = irradiance(request);
      request.sky->earth = true;
      const auto sky = test::query_sky(renderer(), request);
      const double sun = sun_radius_deg(*sky.at(0).distance_m / kAstronomicalUnit_m) * kRadiansPerDegree,
                   earth = std::asin(6.372e6 / *sky.at(1).distance_m),
                   apart = std::acos(sky.at(0).direction.dot(sky.at(1).direction));
      const auto segment = [&](double r, double other) {  // of a circle, behind the common chord
        const double to_chord = (apart * apart + r * r - other * other) / (2 * apart);
        const double half = std::acos(std::clamp(to_chord / r, -1.0, 1.0));
        return r * r * (half - std::sin(half) * std::cos(half));
      };
      const double covered = (segment(sun, earth) + segment(earth, sun)) / (std::numbers::pi * sun * sun);
      EXPECT_NEAR(seen / sky.at(0).irradiance_w_m2, 1 - covered, 0.01) << utc << ", " << fov_deg << " degrees";
      EXPECT_NEAR(share_of_sun_covered(utc, request.pose.position_m), covered, 0.01) << utc;
      EXPECT_EQ(sky.at(0).hidden_by, apart < earth ? HiddenBy::earth : HiddenBy::none) << utc;
      partial += covered > 0.05 && covered < 0.95;
    }
  EXPECT_GE(partial, 6);
}

TEST_F(SkyOfAMoonWithoutRelief, ACoveredSunScattersNothingIntoTheImage) {
  for (const auto& [utc, free] : {std::pair{"2025-03-14T06:59:00Z", false}, {kUtc, true}}) {
    FrameRequest request = looking_beside(SkyKind::sun, utc, test::square_camera(64, 10), 30);
    request.sun.direction = sun_at(utc).direction;
    request.sensor = noiseless();
    request.sensor->optics.stray_light = {1, 0.01, -1.5, 40};
    request.products = kImage;
    EXPECT_EQ(renderer().render(request).report.glare_w_m2_sr > 0, free) << utc;
  }
}

TEST_F(SkyOfAMoonWithoutRelief, TooManyStarsAreRefused) {
  FrameRequest request = looking_up();
  request.sky->magnitude_limit = 1.9;
  EXPECT_TRUE(test::query_sky(renderer(), request).empty());
  request.sky->magnitude_limit = 2;
  EXPECT_EQ(test::query_sky(renderer(), request).size(), 25u);
}

// The Sun beside the Moon: irradiance and centroid; half behind the limb: half of the light.
TEST_F(SkyOfAMoonWithoutRelief, TheSunIsItsDisc) {
  FrameRequest request = looking_up();
  request.sky->stars.reset(), request.sky->sun = true;
  const SunPosition sun = sun_at(kUtc);
  request.sun.direction = sun.direction, request.sun.distance_au = sun.distance_au;
  request.camera = test::square_camera(128, 2);
  const Vec3 place = 1e7 * sun.direction.cross(Vec3::unit_z()).normalized();
  request.pose = test::looking(place, sun.direction, Vec3::unit_z());
  const double flux = solar_irradiance_w_m2(*request.band) / (sun.distance_au * sun.distance_au);
  const double f = request.camera.fx, pixel_sr = 1 / (f * f);
  const SkyObject listed = test::query_sky(renderer(), request).at(0);
  const Blob b = blob(renderer().render(request).products.radiance, 128, listed.x_px, listed.y_px, 30);
  EXPECT_NEAR(b.sum * pixel_sr / flux, 1, 2e-3);
  EXPECT_NEAR(b.x_px, listed.x_px, 0.01);
  EXPECT_NEAR(b.y_px, listed.y_px, 0.01);
  // The limb goes through the Sun's centre.
  const Vec3 aside = sun.direction.cross(Vec3::unit_z()).normalized();
  request.pose = test::looking(kMoonRadius_m * aside - 8e6 * sun.direction, sun.direction, Vec3::unit_z());
  const std::vector<float> half = renderer().render(request).products.radiance;
  double sum = 0;
  for (const float value : half) sum += value > 1e4F ? static_cast<double>(value) : 0;
  EXPECT_NEAR(sum * pixel_sr / flux, 0.5, 0.02);  // the limb is curved: a sagitta of 1 % of the disc
}

TEST_F(SkyOfAMoonWithoutRelief, TheEarthHasItsPhaseAndIrradiance) {
  // At the quarter, and a crescent thinner than a pixel.
  for (const auto& [utc, tolerance] : {std::pair{"2026-11-17T12:00:00Z", 0.005}, {kUtc, 0.01}}) {
    FrameRequest request = looking_up();
    request.sky->stars.reset(), request.sky->earth = true, request.sky->utc = utc;
    request.camera = test::square_camera(256, 3);
    const Earth earth = earth_at(utc);
    const Vec3 place = 5e6 * earth.direction, sun = sun_at(utc).direction;
    request.pose = test::looking(place, earth.direction, Vec3::unit_z());
    const SkyObject listed = test::query_sky(renderer(), request).at(0);
    const Blob b = blob(renderer().render(request).products.radiance, 256, listed.x_px, listed.y_px, 100);
    const double f = request.camera.fx;
    EXPECT_NEAR(b.sum / (f * f) / listed.irradiance_w_m2, 1, tolerance) << utc;
    EXPECT_NEAR(*listed.phase_deg, std::acos(std::clamp(-earth.direction.dot(sun), -1.0, 1.0)) * kDegreesPerRadian,
                0.3);
    // The light is on the Sun's side of the centre, along the way to the Sun.
    const View view(request.camera, request.pose);
    const Vec3 across = (sun - sun.dot(listed.direction) * listed.direction).normalized();
    const auto toward = view.project(place + 1e9 * (listed.direction + 0.005 * across));
    ASSERT_TRUE(toward);
    const Vec2 light(b.x_px - listed.x_px, b.y_px - listed.y_px),
        side(toward->x - listed.x_px, toward->y - listed.y_px);
    EXPECT_GT(light.dot(side) / (light.norm() * side.norm()), 0.999) << utc;
  }
}

// In pixels of 0.16 and of 1.6 degrees, the Earth's radius being one: wherever it is.
TEST_F(SkyOfAMoonWithoutRelief, AThinCrescentKeepsItsLight) {
  for (const char* utc : {kUtc, "2026-11-24T12:00:00Z"})  // phases of 172.7 and 174.6 degrees
    for (const auto& [fov_deg, tolerance] : {std::pair{20.0, 0.002}, {120.0, 0.006}})  // large pixels aren't flat
      for (int i = 0; i < 6; ++i) {
        const FrameRequest request =
            looking_beside(SkyKind::earth, utc, test::square_camera(128, fov_deg), 0.011 * i * fov_deg, 0.004 * i);
        EXPECT_NEAR(irradiance(request) / test::query_sky(renderer(), request).at(0).irradiance_w_m2, 1, tolerance)
            << utc << ", " << fov_deg << " degrees, pointing " << i;
      }
}

TEST_F(SkyOfAMoonWithoutRelief, WideLensesImageWholeDiscs) {
  Camera pinhole = test::square_camera(4096, 150), fisheye = test::square_camera(2048, 90);
  pinhole.height = 200, pinhole.cy = 99.5;
  fisheye.model = CameraModel::fisheye, fisheye.fx = fisheye.fy = 1024 / (170 * kRadiansPerDegree);
  fisheye.height = 400, fisheye.cy = 199.5;
  for (const SkyKind kind : {SkyKind::earth, SkyKind::sun})
    for (const auto& [camera, off_deg] :
         {std::pair{pinhole, 0.0}, {pinhole, 73.0}, {fisheye, 90.0}, {fisheye, 160.0}}) {
      FrameRequest request = looking_beside(kind, "2026-11-10T00:00:00Z", camera, off_deg);
      request.terrain = false;  // the fisheye would see the Moon, too
      EXPECT_NEAR(irradiance(request) / test::query_sky(renderer(), request).at(0).irradiance_w_m2, 1, 0.002)
          << static_cast<int>(kind) << ", " << off_deg << " degrees off";
    }
}

// A camera that doesn't move, whose rows have their own views all the same.
TEST_F(SkyOfAMoonWithoutRelief, RowsSeeTheEdgeOfADiscBesideThem) {
  for (const SkyKind kind : {SkyKind::earth, SkyKind::sun})
    for (const double below_deg : {-2.2, -1.5, 0.0, 1.5, 2.2}) {
      FrameRequest request = looking_beside(kind, "2026-11-10T00:00:00Z", test::square_camera(128, 4), 0.1, below_deg);
      const std::vector<float> still = renderer().render(request).products.radiance;
      request.shutter.emplace().line_time_s = 1e-6;
      EXPECT_GT(*std::max_element(still.begin(), still.end()), 0);
      EXPECT_EQ(renderer().render(request).products.radiance, still) << static_cast<int>(kind) << ", " << below_deg;
    }
}

// Lines that are taken more often than a pixel goes by show the disc as often, and all of it.
TEST_F(SkyOfAMoonWithoutRelief, ASlowScanShowsTheWholeDisc) {
  constexpr double kPixel_deg = 1 / 32.0;
  for (const double step_px : {1.0, 0.5, 0.25, -0.25}) {
    Camera camera = test::square_camera(128, 4);
    camera.fx = camera.fy = 1 / (kPixel_deg * kRadiansPerDegree), camera.height = 400, camera.cy = 199.5;
    FrameRequest request =
        looking_beside(SkyKind::earth, "2026-11-10T00:00:00Z", camera, 0.1, 200 * step_px * kPixel_deg);
    request.shutter.emplace();
    request.shutter->pushbroom = true, request.shutter->line_time_s = 1e-3;
    request.shutter->rates.angular_rate_deg_s.x() = -step_px * kPixel_deg / 1e-3;
    const std::vector<float> radiance = renderer().render(request).products.radiance;
    double sum = 0;
    for (const float value : radiance) sum += static_cast<double>(value);
    const double pixel_sr = std::pow(kPixel_deg * kRadiansPerDegree, 2) * std::abs(step_px);
    EXPECT_NEAR(sum * pixel_sr / test::query_sky(renderer(), request).at(0).irradiance_w_m2, 1, 0.005) << step_px;
  }
}

TEST_F(SkyOfAMoonWithoutRelief, ASlowScanShowsAStarAsOften) {
  constexpr double kPixel_deg = 1 / 32.0;
  FrameRequest request = looking_up();
  request.camera.fx = request.camera.fy = 1 / (kPixel_deg * kRadiansPerDegree);
  request.sky->stars = grid_of_stars(View(request.camera, request.pose).middle(), 3, 0);
  const Quat middle = request.pose.camera_from_moon;
  const auto turned = [&](double px) {
    const AngleAxis turn(-px * kPixel_deg * kRadiansPerDegree, Vec3::unit_x());
    return Quat(turn) * middle;
  };
  const double off_px = test::query_sky(renderer(), request).at(0).y_px - request.camera.cy;  // by aberration
  const auto times_shown = [&] {
    const std::vector<float> radiance = renderer().render(request).products.radiance;
    double sum = 0;
    for (const float value : radiance) sum += static_cast<double>(value);
    return sum * std::pow(kPixel_deg * kRadiansPerDegree, 2);
  };
  const double once = times_shown();
  EXPECT_GT(once, 0);
  request.shutter.emplace();
  request.shutter->pushbroom = true, request.shutter->line_time_s = 1e-3;
  for (const double step_px : {1.0, 0.5, 0.25, -0.25}) {
    request.shutter->rates.angular_rate_deg_s.x() = -step_px * kPixel_deg / 1e-3;
    request.pose.camera_from_moon = turned(64.3 * step_px);
    EXPECT_NEAR(times_shown() / once, 1 / std::abs(step_px), 0.005 / std::abs(step_px)) << step_px;
  }
  // At rest: beside the line that all rows have, by up to a pixel.
  request.shutter->rates.angular_rate_deg_s = Vec3::zero();
  for (const double beside_px : {0.0, 0.4, 0.6, -0.9, 1.2}) {
    request.pose.camera_from_moon = turned(-off_px + beside_px);
    EXPECT_NEAR(times_shown() / once, 128 * std::max(1 - std::abs(beside_px), 0.0), 0.1) << beside_px;
  }
}

// A camera that doesn't move, whose rows have their own views all the same. By its principal point, a star is in the
// middle or on either side of the image's border.
TEST_F(SkyOfAMoonWithoutRelief, RowsSeeStarsBesideThem) {
  for (const double cy : {63.5, -0.3, -0.6, 127.8, 128.2}) {
    FrameRequest request = looking_up();
    request.camera.cy = cy;
    request.sensor = noiseless();
    request.sensor->optics.point_spread.model = PointSpread::Model::gaussian,
    request.sensor->optics.point_spread.sigma_px = 0.8;
    request.products = kImage | kRadiance;
    const FrameProducts still = renderer().render(request).products;
    EXPECT_GT(*std::max_element(still.image.begin(), still.image.end()), 100);
    request.shutter.emplace().line_time_s = 1e-6;
    const FrameProducts rows = renderer().render(request).products;
    EXPECT_EQ(rows.radiance, still.radiance) << cy;
    EXPECT_EQ(rows.image, still.image) << cy;
  }
}

}  // namespace
}  // namespace selenograph::engine
