// Light from terrain beside rays in every direction, on real ground.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "engine/renderer.h"
#include "engine/verify/indirect_error.h"
#include "tests/support/effort.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

constexpr int kStrata = 24;  // for a Sun that is not low

IndirectTruth::Error compare(const Renderer& renderer, const FrameRequest& request, double spacing_px,
                             int strata = kStrata) {
  const IndirectTruth truth(renderer, request, {strata, test::full_effort() ? IndirectTruth::kAzimuths : 360});
  FrameRequest with = truth.request();
  with.indirect.spacing_px = spacing_px;
  return truth.of(renderer.render(with).products.irradiance);
}

FrameRequest above(double lat_deg, double lon_deg, double height_m, double sun_elevation_deg,
                   double sun_azimuth_deg = 90) {
  FrameRequest request = test::blank_request();
  request.camera = test::square_camera(216, 43.28);
  const Vec3 eye = to_cartesian({lat_deg, lon_deg, height_m});
  request.pose = test::looking(eye, -eye, Vec3::UnitZ());
  request.sun.direction = sun_direction(local_axes(lat_deg, lon_deg), sun_azimuth_deg, sun_elevation_deg);
  return request;
}

void say(const IndirectTruth::Error& found, double elevation_deg) {
  fmt::print("Sun {} degrees high: ratio {:.4f}, in shadow {:.4f}, median {:.4f}, rms {:.4f}, worst {:.4f}\n",
             elevation_deg, found.ratio, found.shadow_ratio, found.median, found.rms, found.worst);
}

// Posts of 118 m in pixels of 55 m.
TEST(IndirectLight, AgreesWithRaysAtHadley) {
  const std::string folder = test::shared_data("hadley");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  const Renderer renderer(test::open_terrain(folder), RendererOptions{2, std::size_t{512} << 20});
  for (const auto& [elevation_deg, model] : {std::pair(15.0, ReflectanceModel::hapke),
                                             {15.0, ReflectanceModel::lommel_seeliger},
                                             {3.0, ReflectanceModel::lommel_seeliger},
                                             {40.0, ReflectanceModel::lommel_seeliger}}) {
    if (model != ReflectanceModel::hapke && !test::full_effort()) continue;
    const bool low = elevation_deg < 5;
    FrameRequest request = above(26.0, 3.8, 15000, elevation_deg);
    request.reflectance.model = model;
    const IndirectTruth::Error found =
        compare(renderer, request, IndirectLight::kDefaultSpacing_px, low ? 72 : kStrata);
    say(found, elevation_deg);
    EXPECT_EQ(found.places, 144);
    EXPECT_NEAR(found.ratio, 1, 0.02) << elevation_deg;
    EXPECT_LT(found.rms, low ? 0.06 : 0.03) << elevation_deg;
    // Fewer rays are less sure. Hapke's opposition peak is narrower than azimuths are apart.
    const double worst = model == ReflectanceModel::hapke ? 0.2 : test::full_effort() ? 0.1 : 0.12;
    EXPECT_LT(found.worst, worst) << elevation_deg;
  }
}

// Posts of 5 m in pixels of 6 m. Light comes from low in the sky: near the few crests that it grazes, a smooth normal
// and facets of 5 m differ in what they see of it. At 1.5 degrees it is 5e-5 of sunlight.
TEST(IndirectLight, AgreesWithRaysNearThePole) {
  const std::string folder = test::shared_data("real/NPC_final_adj_5mpp_surf_piece_2km_2_1.tif");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  const Renderer renderer(test::open_terrain(folder), RendererOptions{2, std::size_t{2} << 30});
  struct Case {
    double elevation_deg, spacing_px, ratio, median, rms, worst;
  };
  for (const Case& c : {Case{1.5, 0.5, 0.02, 0.04, 0.1, 0.15},
                        {1.5, 1, 0.05, 0.05, 0.15, 0.1},
                        {2, 4, 0.2, 0.2, 0.5, 0.8},
                        {5, 0.5, 0.02, 0.03, 0.05, 0.15},
                        {5, 1, 0.04, 0.04, 0.1, 0.3},
                        {5, 4, 0.08, 0.1, 0.3, 0.6}}) {
    // A lower Sun takes four times as many rays.
    if ((c.spacing_px != 4 || c.elevation_deg < 3) && !test::full_effort()) continue;
    const IndirectTruth::Error found = compare(renderer, above(-84.81, 125.95, -1500, c.elevation_deg), c.spacing_px,
                                               c.elevation_deg < 3 ? 36 : kStrata);
    say(found, c.elevation_deg);
    EXPECT_NEAR(found.ratio, 1, c.ratio) << c.elevation_deg << " " << c.spacing_px;
    EXPECT_LT(found.median, c.median) << c.elevation_deg << " " << c.spacing_px;
    EXPECT_LT(found.rms, c.rms) << c.elevation_deg << " " << c.spacing_px;
    EXPECT_LT(found.worst, c.worst) << c.elevation_deg << " " << c.spacing_px;
    if (c.elevation_deg >= 2) {
      EXPECT_GE(found.shadow_ratio, IndirectLight::shadow_light_at_least(c.elevation_deg).value());
      if (c.spacing_px == IndirectLight::kDefaultSpacing_px) {
        EXPECT_NEAR(found.shadow_ratio, 1, 0.03) << c.elevation_deg;
      }
    }
  }
}

// A dark hillside that the ground at its upper edge lights, where the data end.
TEST(IndirectLight, AgreesWithRaysBelowTheBorderOfTheData) {
  const std::string file = test::shared_data("real/mesh_2km_5mpix.tif");
  SELENOGRAPH_SKIP_WITHOUT(file);
  const Renderer renderer(test::open_terrain(file), RendererOptions{2, std::size_t{1} << 30});
  const IndirectTruth::Error found =
      compare(renderer, above(-84.1906, 86.5858, -2650, 5, 30), IndirectLight::kDefaultSpacing_px);
  say(found, 5);
  EXPECT_NEAR(found.shadow_ratio, 1, 0.03);
}

}  // namespace
}  // namespace selenograph::engine
