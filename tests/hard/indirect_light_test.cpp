// Light from terrain beside rays in every direction, on real ground.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "engine/radiometry/brdf.h"
#include "engine/radiometry/photometry.h"
#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

struct Place {
  Vec3 position_m, normal;
  double light;  // from terrain, W m-2
};

// What arrives at a place from all ground around: rays in strata of azimuth and elevation, `strata` of these where most
// ground is seen, low in the sky. What a low Sun lights is thin strips: with 80 the answer itself is off by a tenth.
double by_rays(const Renderer& renderer, const Place& place, const FrameRequest& request, int strata) {
  constexpr int kAzimuths = 128, kHigh = 8;
  constexpr double kBorder = 0.4, kPi = std::numbers::pi;
  // Denser towards the horizon.
  const auto low = [&](double row) {
    const double u = 2 * row / strata - 1;
    return kBorder * u * (0.15 + 0.85 * u * u);
  };
  const EastNorthUp axes = local_axes(place.position_m.normalized());
  std::vector<Ray> rays;
  std::vector<double> weights;
  for (int row = 0; row < strata + kHigh; ++row) {
    const bool is_low = row < strata;
    const double height = is_low ? low(row + 1) - low(row) : (kPi / 2 - kBorder) / kHigh,
                 elevation = is_low ? low(row + 0.5) : kBorder + (row - strata + 0.5) * height;
    for (int k = 0; k < kAzimuths; ++k) {
      const double phi = 2 * kPi * (k + 0.25 + 0.5 * (row % 2)) / kAzimuths;
      const Vec3 direction = std::cos(elevation) * (std::cos(phi) * axes.east + std::sin(phi) * axes.north) +
                             std::sin(elevation) * axes.up;
      const double cosine = direction.dot(place.normal);
      if (cosine <= 0) continue;
      rays.push_back({place.position_m + 1e-3 * axes.up, direction});
      weights.push_back(cosine * std::cos(elevation) * height * 2 * kPi / kAzimuths);
    }
  }
  const std::vector<RayHit> hits = renderer.cast(rays, request.sun);
  const Brdf brdf(request.reflectance);
  double sum = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    // Its own facet, which the interpolated normal differs from, is not in sight.
    if (!hits[i].hit || hits[i].range_m < 2) continue;
    const double mu0 = hits[i].normal.dot(request.sun.direction);
    if (!(mu0 > 0 && hits[i].lit > 0)) continue;
    const Vec3 back = -rays[i].direction;
    sum += weights[i] * hits[i].lit *
           brdf.times_mu0(mu0, std::max(hits[i].normal.dot(back), 0.0), back.dot(request.sun.direction));
  }
  return kSolarConstant_w_m2 * sum;
}

struct Agreement {
  double ratio, rms;  // of the means; of the differences, over the mean
  double worst;       // where the light exceeds 1e-4 of sunlight
  double median;      // of the differences over the place's own light
  int places;
};

Agreement compare(const Renderer& renderer, FrameRequest request, double spacing_px, int strata = 256) {
  request.indirect.terrain = true, request.indirect.spacing_px = spacing_px;
  request.products = kPosition | kNormal | kIrradiance;
  const Frame frame = renderer.render(request);
  double ours = 0, truths = 0, squares = 0;
  Agreement out{};
  std::vector<double> differences;
  const int side = request.camera.width;
  for (int row = 5; row < side; row += 16)
    for (int column = 5; column < side; column += 16) {
      const auto pixel = static_cast<std::size_t>(row * side + column);
      const Place place{test::at3(frame.products.position, pixel), test::at3(frame.products.normal, pixel),
                        static_cast<double>(frame.products.irradiance[3 * pixel + 1])};
      if (std::isnan(place.light)) continue;
      const double truth = by_rays(renderer, place, request, strata);
      ours += place.light, truths += truth, squares += std::pow(place.light - truth, 2);
      differences.push_back(std::abs(place.light / truth - 1));
      if (truth > 1e-4 * kSolarConstant_w_m2) out.worst = std::max(out.worst, std::abs(place.light / truth - 1));
      ++out.places;
    }
  const auto middle = differences.begin() + out.places / 2;
  std::nth_element(differences.begin(), middle, differences.end());
  out.median = *middle;
  out.ratio = ours / truths, out.rms = std::sqrt(squares / out.places) / (truths / out.places);
  return out;
}

FrameRequest above(double lat_deg, double lon_deg, double height_m, double sun_elevation_deg) {
  FrameRequest request = test::blank_request();
  request.camera = test::square_camera(96, 20);
  const Vec3 eye = to_cartesian({lat_deg, lon_deg, height_m});
  request.pose = test::looking(eye, -eye, Vec3::UnitZ());
  request.sun.direction = sun_direction(local_axes(lat_deg, lon_deg), 90, sun_elevation_deg);
  return request;
}

// Posts of 118 m in pixels of 55 m.
TEST(IndirectLight, AgreesWithRaysAtHadley) {
  const std::string folder = test::shared_data("hadley");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  const Renderer renderer(test::open_terrain(folder), RendererOptions{2, std::size_t{512} << 20});
  for (const double elevation_deg : {3.0, 15.0, 40.0}) {
    const bool low = elevation_deg < 5;
    const Agreement found =
        compare(renderer, above(26.0, 3.8, 15000, elevation_deg), IndirectLight::kDefaultSpacing_px, low ? 768 : 256);
    EXPECT_EQ(found.places, 36);
    EXPECT_NEAR(found.ratio, 1, 0.02) << elevation_deg;
    EXPECT_LT(found.rms, low ? 0.06 : 0.03) << elevation_deg;
    EXPECT_LT(found.worst, 0.1) << elevation_deg;
  }
}

// Posts of 5 m in pixels of 6 m. Light comes from low in the sky: near the few crests that it grazes, a smooth normal
// and facets of 5 m differ in what they see of it. At 1.5 degrees it is 5e-5 of sunlight.
TEST(IndirectLight, AgreesWithRaysNearThePole) {
  const std::string folder = test::shared_data("real/NPC_final_adj_5mpp_surf_piece_2km_2_1.tif");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  const Renderer renderer(test::open_terrain(folder), RendererOptions{2, std::size_t{512} << 20});
  struct Case {
    double elevation_deg, spacing_px, ratio, median, rms;
  };
  for (const Case& c : {Case{1.5, 1, 0.08, 0.04, 0.35}, {5, 1, 0.02, 0.02, 0.1}, {5, 4, 0.04, 0.04, 0.2}}) {
    const Agreement found =
        compare(renderer, above(-84.81, 125.95, -1500, c.elevation_deg), c.spacing_px, c.elevation_deg < 3 ? 384 : 256);
    EXPECT_NEAR(found.ratio, 1, c.ratio) << c.elevation_deg << " " << c.spacing_px;
    EXPECT_LT(found.median, c.median) << c.elevation_deg << " " << c.spacing_px;
    EXPECT_LT(found.rms, c.rms) << c.elevation_deg << " " << c.spacing_px;
  }
}

}  // namespace
}  // namespace selenograph::engine
