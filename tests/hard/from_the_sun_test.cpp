// Seen from the Sun's direction nothing visible is in shadow: what the Sun's ray meets first is what the Sun shines on.
//
// Asked with rays exactly along the sunlight, and with frames from the Sun's own distance (rays spread by 1e-8 rad: a
// millimetre over 100 km) and from 400 000 km (up to 4e-6 rad: 0.4 m). Terrain is closed all around: at the rim of a
// mosaic light would come from beneath.
//
// One exception can't be avoided while float finds triangles: a primary ray that starts where it enters the terrain's
// shell, up to 100 km before a grazed outline, passes it within float's rounding there (about 1 cm) on the wrong side,
// and sees a point that is in shadow indeed. Each such point must lie behind an outline that its ray passes within 5 cm
// (and what the spread allows over 100 km), and there may be at most one in 100 000.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "dem/sample/sample_terrain.h"
#include "dem/terrain/terrain.h"
#include "engine/renderer.h"
#include "tests/support/effort.h"
#include "tests/support/float_tiles.h"
#include "tests/support/judge.h"
#include "tests/support/queries.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

constexpr int kSunSide = 64, kRaysPerCast = 512;
const int kViews = cases(200), kCasts = cases(100);
constexpr double kAu_m = 1.495978707e11;
// Lommel-Seeliger at phase 0, where emission is incidence, doesn't know slopes: the whole frame has one radiance.
constexpr double kOpposition = 1361 * 0.12 / (4 * std::numbers::pi);

struct Area {
  double south_deg, north_deg, west_deg, east_deg;
  bool holds(const Vec3& p) const {
    const Geographic g = to_geographic(p);
    return g.lat_deg > south_deg && g.lat_deg < north_deg && g.lon_deg > west_deg && g.lon_deg < east_deg;
  }
};

// A place, and a Sun over it.
struct SunAim {
  Vec3 target, sun;
};

struct Count {
  std::size_t seen = 0, shadowed = 0, unexplained = 0;
  // A smoothed normal may lean away from a Sun that sees the facet itself: dark by its own formula, not a shadow.
  std::size_t turned = 0;
};

class Sunlight {
 public:
  // `area` is where to aim, and within which normals that lean away count.
  Sunlight(const std::string& folder, const Area& area)
      : area_(area), renderer_(open_terrain(folder), {1, std::size_t{512} << 20}) {}

  // Half of the Suns below 20 degrees, where shadows are.
  SunAim random_aim() {
    std::uniform_real_distribution<double> unit(0, 1);
    const double lat = area_.south_deg + (area_.north_deg - area_.south_deg) * unit(random_),
                 lon = area_.west_deg + (area_.east_deg - area_.west_deg) * unit(random_);
    const double elevation = unit(random_) < 0.5 ? 1 + 19 * unit(random_) : std::asin(unit(random_)) / kDegree;
    const double height = renderer_.terrain().height(lat, lon).height_m;
    return {to_cartesian({lat, lon, height}), local_sun(lat, lon, 360 * unit(random_), elevation).normalized()};
  }

  void cast_parallel_rays(const char* name) {
    std::uniform_real_distribution<double> across(-500, 500);
    Count c;
    for (int k = 0; k < kCasts; ++k) {
      const SunAim aim = random_aim();
      const Vec3 u = aim.sun.unitOrthogonal(), v = aim.sun.cross(u);
      std::vector<engine::Ray> rays;
      for (int i = 0; i < kRaysPerCast; ++i)
        rays.push_back({aim.target + 2e5 * aim.sun + across(random_) * u + across(random_) * v, -aim.sun});
      for (const engine::RayHit& hit : test::cast_rays(renderer_, rays, engine::Sun{aim.sun, 1, 0}))
        if (hit.hit) count(hit.position_m, -aim.sun, hit.lit == 0, hit.normal.dot(aim.sun) <= 0, 0, c);
    }
    conclude(fmt::format("{}, parallel rays", name), kCasts, c);
    EXPECT_GT(c.seen, static_cast<std::size_t>(kCasts * kRaysPerCast / 2));
  }

  void look(const char* name) {
    Count c;
    double uneven = 0;
    for (int k = 0; k < kViews; ++k) {
      const SunAim aim = random_aim();
      std::uniform_real_distribution<double> decade(0, 1);
      const double width_m = 300 * std::pow(10, decade(random_));
      const double distance_m = k % 2 ? kAu_m : 4e8;
      engine::FrameRequest q = from_the_sun(aim, width_m, distance_m);
      q.accuracy.max_error_px = k % 4 < 2 ? 0.5 : 0;
      const engine::Frame frame = renderer_.render(q);
      const double spread = width_m / distance_m;
      for (std::size_t i = 0; i < frame.products.lit.size(); ++i) {
        if (std::isnan(frame.products.lit[i])) continue;
        const Vec3 place = at3(frame.products.position, i);
        count(place, (place - q.pose.position_m).normalized(), frame.products.lit[i] == 0,
              frame.products.angles[3 * i] >= 90, spread, c);
        if (frame.products.lit[i] == 0) continue;
        // L / L0 - 1 = (mu0 - mu) / (mu0 + mu), and cosines differ by the phase at most.
        const double mu = std::cos(static_cast<double>(frame.products.angles[3 * i + 1]) * kDegree);
        const double off = std::abs(static_cast<double>(frame.products.radiance[i]) / kOpposition - 1);
        if (mu > 0.02) uneven = std::max(uneven, off * 2 * mu / (spread + 1e-6));
      }
    }
    conclude(fmt::format("{}, frames", name), kViews, c);
    fmt::print("{:<24} radiance of what is lit off the opposition's by at most {:.2f} of what the phase allows\n", "",
               uneven);
    EXPECT_GT(c.seen, static_cast<std::size_t>(kViews * kSunSide * kSunSide / 2));
    EXPECT_LT(uneven, 1);
  }

 private:
  static engine::FrameRequest from_the_sun(const SunAim& aim, double width_m, double distance_m) {
    engine::FrameRequest q = blank_request();
    const double f = kSunSide / width_m * distance_m;
    q.camera = {kSunSide, kSunSide, f, f, (kSunSide - 1) / 2.0, (kSunSide - 1) / 2.0, {}};
    q.pose = looking(aim.target + distance_m * aim.sun, -aim.sun, local_axes(aim.target).north);
    q.sun.direction = aim.sun;
    q.products = engine::kLit | engine::kRadiance | engine::kAngles | engine::kPosition;
    return q;
  }

  void count(const Vec3& place, const Vec3& direction, bool dark, bool leans_away, double spread, Count& c) const {
    ++c.seen;
    c.turned += leans_away && area_.holds(place);
    if (!dark || leans_away) return;
    ++c.shadowed;
    c.unexplained += !past_an_outline(place, direction, 0.05 + 1e5 * spread / 2);
  }

  // Whether a ray a little aside ends well before the place.
  bool past_an_outline(const Vec3& place, const Vec3& direction, double aside_m) const {
    constexpr double kBefore_m = 1e5;
    const Vec3 u = direction.unitOrthogonal(), v = direction.cross(u);
    std::vector<engine::Ray> rays;
    for (int k = 0; k < 8; ++k)
      rays.push_back(
          {place - kBefore_m * direction + aside_m * (std::cos(k * 45 * kDegree) * u + std::sin(k * 45 * kDegree) * v),
           direction});
    const auto hits = test::cast_rays(renderer_, rays);
    return std::any_of(hits.begin(), hits.end(),
                       [](const engine::RayHit& hit) { return hit.hit && hit.range_m < kBefore_m - 1; });
  }

  static void conclude(const std::string& name, int views, const Count& c) {
    fmt::print("{:<24} {} views, {} points: {} in shadow, of these not at an outline {}; {} normals lean away\n", name,
               views, c.seen, c.shadowed, c.unexplained, c.turned);
    EXPECT_EQ(c.unexplained, 0U);
    EXPECT_LE(c.shadowed * 100'000, c.seen);
    EXPECT_EQ(c.turned, 0U) << "black specks at opposition";
  }

  Area area_;
  engine::Renderer renderer_;
  std::mt19937_64 random_{7};
};

class SampleFromTheSun : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    dem::SampleOptions options;
    options.south_deg = -8, options.west_deg = 39, options.rows = options.columns = 1, options.posts_per_degree = 512;
    dem::write_sample_terrain(folder_->path(), options);
    write_global_tile(folder_->path(), 1, [](double, double) { return -300.0; });
    light_ = new Sunlight(folder_->path(), {-7.9, -7.1, 39.1, 39.9});
  }
  static void TearDownTestSuite() {
    delete light_, delete folder_;
    light_ = nullptr, folder_ = nullptr;
  }
  static Sunlight& light() { return *light_; }

 private:
  static inline TemporaryFolder* folder_ = nullptr;
  static inline Sunlight* light_ = nullptr;
};

TEST_F(SampleFromTheSun, ParallelRaysHitLitPoints) { light().cast_parallel_rays("sample"); }
TEST_F(SampleFromTheSun, FramesSeeNoShadow) { light().look("sample"); }

TEST(HadleyFromTheSun, FramesSeeNoShadow) {
  const std::string folder = shared_data("hadley");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  // Far from the mosaic's rim: light that comes from beneath it doesn't get here.
  Sunlight light(folder, {23.5, 25.5, 4, 8});
  light.cast_parallel_rays("hadley");
  light.look("hadley");
}

// A mosaic's rim is open: a low Sun shines beneath the surface there. What it meets from beneath is not to be seen.
TEST(RimFromTheSun, BackFacesAreNotHit) {
  TemporaryFolder folder;
  dem::SampleOptions options;
  options.south_deg = -8, options.west_deg = 39, options.rows = options.columns = 1, options.posts_per_degree = 256;
  dem::write_sample_terrain(folder.path(), options);
  const Judge judge(folder.path());
  const engine::Renderer renderer(open_terrain(folder.path()), {1, std::size_t{512} << 20});
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> unit(0, 1);
  std::size_t above = 0, beneath = 0, wrong = 0, shadowed = 0;
  for (int k = 0; k < 40; ++k) {
    const double lat = -7.9 + 0.8 * unit(random), lon = 39.1 + 0.8 * unit(random);
    const Vec3 sun = local_sun(lat, lon, 360 * unit(random), 0.5 + 4 * unit(random)).normalized();
    const Vec3 target = to_cartesian({lat, lon, 0}), u = sun.unitOrthogonal(), v = sun.cross(u);
    std::vector<engine::Ray> rays;
    for (int i = 0; i < 1000; ++i)
      rays.push_back({target + 1e5 * sun + 2000 * (unit(random) - 0.5) * u + 2000 * (unit(random) - 0.5) * v, -sun});
    const auto hits = test::cast_rays(renderer, rays, engine::Sun{sun, 1, 0});
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const FirstHit truth = judge.first_hit(rays[i].origin_m, rays[i].direction);
      if (truth.hit == Verdict::unknown) continue;  // by a void
      const bool hit = truth.hit == Verdict::yes && truth.from_above;
      above += hit, beneath += truth.hit == Verdict::yes && !truth.from_above;
      wrong += hits[i].hit != hit;
      shadowed += hits[i].hit && hits[i].lit == 0 && hits[i].normal.dot(sun) > 0;
    }
  }
  fmt::print("rim: {} rays from above, {} from beneath: {} answered otherwise, {} points in shadow\n", above, beneath,
             wrong, shadowed);
  EXPECT_GT(above, 1000U);
  EXPECT_GT(beneath, 1000U);
  EXPECT_LE(wrong * 10'000, above + beneath) << "outlines within float's rounding";
  EXPECT_LE(shadowed * 10'000, above);
}

}  // namespace
}  // namespace selenograph::test
