// Light from terrain beside rays in every direction, on real and sample ground, and beside closed forms. Prints the
// rows of engine/indirect/README.md.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "dem/sample/sample_terrain.h"
#include "engine/renderer.h"
#include "tests/support/closed_forms.h"
#include "tests/support/effort.h"
#include "tests/support/float_tiles.h"
#include "tests/support/indirect_truth.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

using engine::FrameRequest;
using engine::ReflectanceModel;
using engine::Renderer;

constexpr int kStrata = 24;  // for a Sun that is not low

class IndirectLight : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    fmt::print(
        "| ground | Sun | spacing_px | ratio | median % | RMS % | worst % | shadow ratio | shadow RMS % |\n"
        "|---|---|---|---|---|---|---|---|---|\n");
  }

  // Returns the error of the frame's light, with posts of light at a spacing, and prints it.
  static IndirectTruth::Error measure(const std::string& ground, double sun_deg, const Renderer& renderer,
                                      const IndirectTruth& truth, double spacing_px) {
    FrameRequest with = truth.request();
    with.indirect.spacing_px = spacing_px;
    const IndirectTruth::Error error = truth.of(renderer.render(with).products.irradiance);
    fmt::print("| {} | {:g} | {:g} | {:.3f} | {:.2f} | {:.2f} | {:.1f} | {:.3f} | {:.2f} |\n", ground, sun_deg,
               spacing_px, error.ratio, 100 * error.median, 100 * error.rms, 100 * error.worst, error.shadow_ratio,
               100 * error.shadow_rms);
    return error;
  }

  static IndirectTruth truth_by_rays(const Renderer& renderer, const FrameRequest& request, int strata = kStrata) {
    return {renderer, request, {strata, full_effort() ? IndirectTruth::kAzimuths : 240}};
  }

  static FrameRequest above(double lat_deg, double lon_deg, double height_m, double sun_elevation_deg,
                            double sun_azimuth_deg = 90) {
    FrameRequest request = blank_request();
    request.camera = square_camera(216, 43.28);
    const Vec3 eye = to_cartesian({lat_deg, lon_deg, height_m});
    request.pose = looking(eye, -eye, Vec3::unit_z());
    request.sun.direction = local_sun(lat_deg, lon_deg, sun_azimuth_deg, sun_elevation_deg);
    return request;
  }
};

// Posts of 118 m in pixels of 55 m.
TEST_F(IndirectLight, AgreesWithRaysAtHadley) {
  const std::string folder = shared_data("hadley");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  const Renderer renderer(open_terrain(folder), engine::RendererOptions{2, std::size_t{512} << 20});
  for (const auto& [elevation_deg, model] : {std::pair(15.0, ReflectanceModel::hapke),
                                             {15.0, ReflectanceModel::lommel_seeliger},
                                             {3.0, ReflectanceModel::lommel_seeliger},
                                             {40.0, ReflectanceModel::lommel_seeliger}}) {
    const bool is_hapke = model == ReflectanceModel::hapke;
    if (!is_hapke && !full_effort()) continue;
    const bool low = elevation_deg < 5;
    FrameRequest request = above(26.0, 3.8, 15000, elevation_deg);
    request.reflectance.model = model;
    const IndirectTruth::Error found =
        measure(is_hapke ? "Hadley, Hapke" : "Hadley", elevation_deg, renderer,
                truth_by_rays(renderer, request, low ? 72 : kStrata), engine::IndirectLight::kDefaultSpacing_px);
    EXPECT_EQ(found.places, 144);
    EXPECT_NEAR(found.ratio, 1, 0.02) << elevation_deg;
    EXPECT_LT(found.rms, low ? 0.06 : 0.03) << elevation_deg;
    // Fewer rays are less sure. Hapke's opposition peak is narrower than azimuths are apart.
    const double worst = is_hapke ? 0.2 : full_effort() ? 0.1 : 0.12;
    EXPECT_LT(found.worst, worst) << elevation_deg;
  }
}

// Posts of 5 m in pixels of 6 m. Light comes from low in the sky: near the few crests that it grazes, a smooth normal
// and facets of 5 m differ in what they see of it. At 1.5 degrees it is 5e-5 of sunlight.
TEST_F(IndirectLight, AgreesWithRaysNearThePole) {
  const std::string folder = shared_data("real/NPC_final_adj_5mpp_surf_piece_2km_2_1.tif");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  const Renderer renderer(open_terrain(folder), engine::RendererOptions{2, std::size_t{2} << 30});
  struct Bounds {
    double spacing_px, ratio, median, rms, worst;
  };
  const std::vector<std::pair<double, std::vector<Bounds>>> suns{
      {1.5, {{0.5, 0.02, 0.04, 0.1, 0.15}, {1, 0.05, 0.05, 0.15, 0.1}}},
      {2, {{4, 0.2, 0.2, 0.5, 0.8}}},
      {5, {{0.5, 0.02, 0.03, 0.05, 0.15}, {1, 0.04, 0.04, 0.1, 0.3}, {4, 0.08, 0.1, 0.3, 0.6}}},
      {10, {{4, 0.08, 0.1, 0.3, 0.6}}}};
  for (const auto& [sun_deg, spacings] : suns) {
    if (sun_deg != 5 && !full_effort()) continue;
    const FrameRequest request = above(-84.81, 125.95, -1500, sun_deg);
    const IndirectTruth truth = truth_by_rays(renderer, request, sun_deg < 3 ? 36 : kStrata);
    for (const Bounds& b : spacings) {
      if (b.spacing_px != engine::IndirectLight::kDefaultSpacing_px && !full_effort()) continue;
      const IndirectTruth::Error found = measure("polar piece", sun_deg, renderer, truth, b.spacing_px);
      EXPECT_NEAR(found.ratio, 1, b.ratio) << sun_deg << " " << b.spacing_px;
      EXPECT_LT(found.median, b.median) << sun_deg << " " << b.spacing_px;
      EXPECT_LT(found.rms, b.rms) << sun_deg << " " << b.spacing_px;
      EXPECT_LT(found.worst, b.worst) << sun_deg << " " << b.spacing_px;
      if (sun_deg < 2) continue;
      EXPECT_GE(found.shadow_ratio, engine::IndirectLight::shadow_light_at_least(sun_deg).value());
      if (b.spacing_px == engine::IndirectLight::kDefaultSpacing_px) {
        EXPECT_NEAR(found.shadow_ratio, 1, 0.03) << sun_deg;
      }
    }
  }
}

// A dark hillside that the ground at its upper edge lights, where the data end.
TEST_F(IndirectLight, AgreesWithRaysBelowTheBorderOfTheData) {
  const std::string file = shared_data("real/mesh_2km_5mpix.tif");
  SELENOGRAPH_SKIP_WITHOUT(file);
  const Renderer renderer(open_terrain(file), engine::RendererOptions{2, std::size_t{1} << 30});
  const FrameRequest request = above(-84.1906, 86.5858, -2650, 5, 30);
  const IndirectTruth::Error found =
      measure("hillside", 5, renderer, truth_by_rays(renderer, request), engine::IndirectLight::kDefaultSpacing_px);
  EXPECT_NEAR(found.shadow_ratio, 1, 0.03);
}

// Wider spacings of posts on terrain of 118 m, in pixels of 290 m (full effort: 145).
TEST_F(IndirectLight, CloserPostsAreNearerToRays) {
  const TemporaryFolder folder;
  dem::SampleOptions options;
  options.south_deg = -1;
  options.west_deg = 29;
  options.rows = 2;
  options.columns = 2;
  options.posts_per_degree = 256;
  dem::write_sample_terrain(folder.path(), options);
  const Renderer renderer(open_terrain(folder.path()), engine::RendererOptions{2, std::size_t{512} << 20});
  std::vector<double> smallest_rms;  // by Sun
  for (const double sun_deg : {15.0, 40.0}) {
    FrameRequest request = above(0.1, 30.1, 10000, sun_deg);
    request.camera = square_camera(full_effort() ? 64 : 32, 50);
    const IndirectTruth truth(renderer, request, {kStrata, full_effort() ? IndirectTruth::kAzimuths : 180});
    std::vector<IndirectTruth::Error> errors;
    for (const double spacing_px : {0.5, 1.0, 2.0, 4.0, 8.0})
      errors.push_back(measure("sample terrain", sun_deg, renderer, truth, spacing_px));
    smallest_rms.push_back(errors.front().rms);
    if (sun_deg > 15) continue;
    EXPECT_NEAR(errors.front().ratio, 1, 0.04);  // crests of a post
    EXPECT_LT(errors.front().rms, errors.back().rms);
    for (const IndirectTruth::Error& error : errors) {
      EXPECT_NEAR(error.shadow_ratio, 1, 0.3);
      EXPECT_LT(error.shadow_rms, 0.6);
    }
  }
  EXPECT_NE(smallest_rms[0], smallest_rms[1]);
}

// Bowls by full effort: unit.indirect has their posts.
TEST_F(IndirectLight, AgreesWithClosedForms) {
  const int side_px = full_effort() ? 256 : 128, width_posts = side_px * 4 / 5;
  std::vector<ClosedForm> forms = trenches();
  if (full_effort())
    for (ClosedForm& bowl : bowls()) forms.push_back(std::move(bowl));
  for (const ClosedForm& form : forms) {
    const TemporaryFolder folder;
    write_ground(form, width_posts, folder / "ground.tif");
    const Renderer renderer(open_terrain(folder / "ground.tif"), engine::RendererOptions{2, std::size_t{512} << 20});
    FrameRequest request = blank_request();
    request.camera = square_camera(side_px, 50);
    const double lat_deg = kClosedFormCenter.lat_deg, lon_deg = kClosedFormCenter.lon_deg;
    const double ground_m = renderer.terrain().height(lat_deg, lon_deg).height_m;
    // A pixel at the centre is as large as a post.
    const Vec3 eye = to_cartesian({lat_deg, lon_deg, ground_m + request.camera.fx * kClosedFormPosts_m});
    request.pose = looking(eye, -eye, Vec3::unit_z());
    request.reflectance = {.model = ReflectanceModel::lambert};
    for (const double sun_deg : form.suns_deg) {
      request.sun.direction = local_sun(lat_deg, lon_deg, form.sun_azimuth_deg, sun_deg);
      const IndirectTruth truth(renderer, request, [&](const Vec3& position_m) {
        return light_w_m2(form, width_posts, position_m, sun_deg, request.reflectance.rho);
      });
      const double ratio =
          measure(form.name, sun_deg, renderer, truth, engine::IndirectLight::kDefaultSpacing_px).ratio;
      EXPECT_NEAR(ratio, 1, !form.is_round ? 0.02 : sun_deg > 5 ? 0.05 : 0.2) << form.name << ' ' << sun_deg;
    }
  }
}

}  // namespace
}  // namespace selenograph::test
