// Craters and relief below the posts: against the laws that they are made by, and as terrain.
#include "dem/detail/detail.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <numbers>
#include <optional>
#include <random>
#include <regex>
#include <set>
#include <stdexcept>
#include <string>

#include "api/assets/assets.h"
#include "dem/base/noise.h"
#include "dem/detail/detail_kernels.h"
#include "dem/detail/detailed_terrain.h"
#include "dem/detail/features.h"
#include "dem/detail/footprints.h"
#include "dem/detail/region.h"
#include "dem/detail/unloaded_blocks.h"
#include "dem/posts/resolved_posts.h"
#include "tests/support/effort.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

using std::numbers::pi;
using test::open_terrain;
using test::TemporaryFolder;
using test::write_kaguya_tile;

// --- noise

TEST(Noise, OfOneCellIsTheSameToTheBit) {
  std::mt19937 random(20261126);
  std::uniform_real_distribution<double> place(-7e6, 7e6), angle(0, 2 * pi);
  for (const double step : {1e-4, 0.003, 0.02, 0.05, 0.08, 0.2}) {
    for (int row = 0; row < 200; ++row) {
      constexpr std::size_t kPlaces = 128;
      std::array<double, kPlaces> x, y, expected, heights;
      // Some rows begin at a cell's corner, where a place is of the cell above.
      const double x0 = row % 3 == 0 ? std::round(place(random)) : place(random), y0 = place(random), z = place(random),
                   a = angle(random);
      for (std::size_t i = 0; i < kPlaces; ++i) {
        x[i] = x0 + step * std::cos(a) * static_cast<double>(i),
        y[i] = y0 + step * std::sin(a) * static_cast<double>(i);
        heights[i] = 1e-3 * static_cast<double>(i);
        expected[i] = heights[i] + 0.7 * static_cast<double>(perlin_noise<float>(x[i], y[i], z, 11));
      }
      add_noise({x.data(), y.data(), z, kPlaces}, 11, 0.7, heights.data());
      ASSERT_EQ(heights, expected) << step;
    }
  }
}

// --- one crater

TEST(CraterShape, FreshIsThePublishedProfile) {
  const CraterShape shape;
  const auto published = [](double r) {
    if (r < 0.98) return -0.228809953 + 0.227533882 * r + 0.083116795 * r * r - 0.039499407 * r * r * r;
    if (r <= 1.02) return 0.036822095;
    return 0.188253307 - 0.187050452 * r + 0.01844746 * r * r + 0.01505647 * r * r * r;
  };
  // A round rim is lower: of the same depth from rim to floor the rest is 6 % deeper.
  const double deeper = shape.height(0.4, 0) / published(0.4);
  EXPECT_NEAR(deeper, 1.06, 0.01);
  for (double r = 0; r < 1.5; r += 0.0137) {
    if (std::abs(r - 1) < 0.12 || r < 0.06) continue;  // the rim is round, and so is the middle
    ASSERT_NEAR(shape.height(r, 0), deeper * published(r), 4e-3) << r;
  }
  EXPECT_NEAR(shape.height(1.6, 0), 0, 1e-6);
}

// Slopes of a fresh crater of a depth of 0.2 diameters turn within a tenth of the radius, those of a worn one slowly.
TEST(CraterShape, OnlyAFreshRimIsSharp) {
  const CraterShape shape;
  const auto turn_deg = [&](double age, double ratio) {
    const double scale = 2 * ratio / CraterShape::kFreshDepth / shape.depth_left(age);  // slope per radius
    const auto slope = [&](double r) {
      return scale * (shape.height(r + 0.01, age) - shape.height(r - 0.01, age)) / 0.02;
    };
    double most = 0;
    for (double r = 0.05; r < CraterShape::reach(age); r += 0.005)
      most = std::max(most, std::abs(std::atan(slope(r + 0.02)) - std::atan(slope(r))) * kDegreesPerRadian);
    return most;
  };
  EXPECT_LT(turn_deg(0, 0.2), 12);
  EXPECT_GT(turn_deg(0, 0.2), 4);
  // As old as 10 m, 36 m and 100 m wide ones are at the end.
  for (const double age : {0.14, 0.165, 0.19}) EXPECT_LT(turn_deg(age, 0.03), 0.2) << age;
}

TEST(CraterShape, AgesAsObserved) {
  const CraterShape shape;
  // Fassett & Thomson: a crater of 1 km keeps 52 % after 3 Ga, by 4 m^2 per Ma; of one with a round rim it is 55 %.
  EXPECT_NEAR(shape.depth_left(4.0 * 3000 / (500 * 500)), 0.546, 0.005);
  for (const double left : {0.9, 0.5, 0.27, 0.15}) EXPECT_NEAR(shape.depth_left(shape.age_of(left)), left, 1e-6);
  double before = 1;
  for (double age = 0.005; age < CraterShape::kOldest; age += 0.005) {
    ASSERT_LT(shape.depth_left(age), before) << age;
    before = shape.depth_left(age);
  }
}

// Diffusion moves ground and makes none: the integral over the plane stays, but for what lies beyond the reach. A
// Gaussian hollow has a closed form; a crater becomes one.
TEST(CraterShape, DiffusionKeepsTheVolume) {
  const CraterShape shape;
  const auto volume = [&](double age) {
    double sum = 0;
    constexpr double kStep = 1e-3;
    for (double r = kStep / 2; r < 6; r += kStep) sum += 2 * pi * r * kStep * shape.height(r, age);
    return sum;
  };
  const double fresh = volume(0);
  EXPECT_NEAR(fresh, -0.118, 0.001);  // the published -0.110, deeper, with a lower rim
  for (const double age : {0.01, 0.1, 0.2, 0.39}) EXPECT_NEAR(volume(age), fresh, 0.05 * std::abs(fresh)) << age;
}

// --- many

CraterLaw small_craters(std::uint64_t seed) {
  CraterLaw law;
  law.seed = seed;
  law.smallest_m = 0.7, law.largest_m = 200;
  law.oldest_Ma = 4400;  // all sizes are in equilibrium
  return law;
}

TEST(CraterAges, FollowFromTheProductionFunctionAndTheLaw) {
  // Neukum, Ivanov & Hartmann (2001), table 1 and equation 5: by hand.
  EXPECT_NEAR(production_per_m2(1000) * 1e6, 8.17e-4, 1e-6);
  EXPECT_NEAR(production_per_m2(10) * 1e6, 3.7e3, 0.1e3);
  EXPECT_NEAR(production_times(3500) * 8.38e-4, 4.8e-3, 0.1e-3);
  for (const double age_Ma : {1.0, 900.0, 3100.0, 4000.0})
    EXPECT_NEAR(age_Ma_of(production_times(age_Ma)), age_Ma, 1e-6 * age_Ma);
  const CraterAges ages(equilibrium(), 1, 1000, 3500);
  // Small craters are as many as the law has, and gone after some time; of large ones all that have formed are there.
  EXPECT_EQ(ages.life(10).share, 1);
  EXPECT_NEAR(age_Ma_of(ages.life(10).worn_out), 136, 2);
  const CraterAges::Life large = ages.life(500);
  EXPECT_NEAR(large.share * equilibrium().between(490, 510),
              production_times(3500) * (production_per_m2(490) - production_per_m2(510)), 1e-9);
  EXPECT_NEAR(age_Ma_of(large.oldest), 3500, 1e-6);
}

TEST(CraterField, CountsAreThoseOfTheLaw) {
  double chi2 = 0;
  int degrees = 0;
  for (const std::uint64_t seed : {1, 2, 3, 4}) {
    const CraterField field(small_craters(seed));
    EXPECT_EQ(field.smallest_octave(), -1);
    EXPECT_EQ(field.largest_octave(), 7);
    for (int k = field.smallest_octave(); k <= field.largest_octave(); ++k)
      for (const double lat : {-88.0, 0.0, 61.0}) {
        const double half_deg = std::ldexp(30.0, k) / kMetresPerDegree;
        const std::vector<Crater> found = field.in_box(k, {lat - half_deg, lat + half_deg, 20, 20 + 2 * half_deg});
        const double radians = 2 * half_deg * kRadiansPerDegree;
        const double area =
            kMoonRadius_m * kMoonRadius_m * radians *
            (std::sin((lat + half_deg) * kRadiansPerDegree) - std::sin((lat - half_deg) * kRadiansPerDegree));
        const double low = std::max(0.7, std::ldexp(1.0, k)), high = std::min(200.0, std::ldexp(2.0, k));
        const double expected = area * std::pow(10, -1.1) * (1 / (low * low) - 1 / (high * high));
        if (expected < 5) continue;
        chi2 += std::pow(static_cast<double>(found.size()) - expected, 2) / expected;
        ++degrees;
        for (const Crater& c : found) {
          ASSERT_GE(c.diameter_m, low);
          ASSERT_LE(c.diameter_m, high);
        }
      }
  }
  ASSERT_GT(degrees, 60);
  // Five standard deviations of chi-square.
  EXPECT_NEAR(chi2, degrees, 5 * std::sqrt(2.0 * degrees));
}

TEST(CraterField, AsManyAreExpectedAsHaveFormed) {
  CraterLaw law;
  law.smallest_m = 500, law.largest_m = 1000;
  const CraterField field(law);
  const Footprint region{-5, 5, 20, 30};
  for (const double smallest_m : {400.0, 700.0}) {
    int found = 0;
    for (int k = field.smallest_octave(); k <= field.largest_octave(); ++k)
      for (const Crater& crater : field.in_box(k, region)) found += crater.diameter_m >= smallest_m;
    const double expected = expected_craters(field, region, smallest_m);
    EXPECT_NEAR(expected, found, 5 * std::sqrt(expected)) << smallest_m;
    // Most have not had the time.
    EXPECT_LT(expected, 0.5 * area_m2(region) * law.frequency.between(std::max(500.0, smallest_m), 1000));
  }
  EXPECT_EQ(expected_craters(field, region, 1000), 0);
}

TEST(CraterField, DiametersAgesAndDepthsAreThoseOfTheLaw) {
  const CraterField field(small_craters(9));
  std::vector<Crater> all = field.in_box(3, {0, 0.15, 0, 0.15});
  ASSERT_GT(all.size(), 5000u);
  double half_way = 0, age = 0, fresh = 0, fresh_ratio = 0;
  for (const Crater& c : all) {
    half_way += c.diameter_m > 8 * std::sqrt(2.0);
    const double ratio = c.scale / c.diameter_m * CraterShape::kFreshDepth;
    age += c.age / field.shape().age_of(kVisible / ratio);
    ASSERT_GE(c.depth_m, 0.999 * kVisible * c.diameter_m);
    if (c.age < 0.003) fresh += 1, fresh_ratio += c.depth_m / c.diameter_m / field.shape().depth_left(c.age);
  }
  const auto n = static_cast<double>(all.size());
  EXPECT_NEAR(half_way / n, 1.0 / 3, 0.03);  // N(>sqrt 2 D) - N(>2 D) over N(>D) - N(>2 D), exponent 2
  EXPECT_NEAR(age / n, 0.5, 0.02);
  ASSERT_GT(fresh, 10);
  EXPECT_NEAR(fresh_ratio / fresh, fresh_depth_over_diameter(11), 0.015);
  EXPECT_NEAR(fresh_depth_over_diameter(100), 0.15, 1e-12);
  EXPECT_NEAR(fresh_depth_over_diameter(1000), 0.21, 1e-12);
  EXPECT_NEAR(fresh_depth_over_diameter(10), 0.11, 1e-12);
  EXPECT_NEAR(fresh_depth_over_diameter(2), 0.14, 1e-12);
}

// What near() finds is what within() finds, whatever the place: poles and the date line, too.
TEST(CraterField, TheSameCratersFromEverywhere) {
  const CraterField field(small_craters(3));
  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(-1, 1);
  for (const Geographic g :
       {Geographic{0, 0, 0}, {26, 3, 0}, {10, 179.9999, 0}, {-75.5, -180, 0}, {89.999, 50, 0}, {-90, 0, 0}}) {
    const Vec3 direction = to_cartesian(g).normalized();
    std::vector<Crater> wide;
    field.near(2, direction, 400, wide);
    std::set<std::uint64_t> ids;
    for (const Crater& c : wide) ASSERT_TRUE(ids.insert(c.id).second);
    ASSERT_GT(ids.size(), 500u);
    const EastNorthUp axes = local_axes(direction * kMoonRadius_m);
    for (int i = 0; i < 20; ++i) {
      const Vec3 beside =
          (direction + (any(random) * axes.east + any(random) * axes.north) * 200 / kMoonRadius_m).normalized();
      std::vector<Crater> some;
      field.near(2, beside, 30, some);
      ASSERT_FALSE(some.empty());
      for (const Crater& c : some) ASSERT_TRUE(ids.contains(c.id)) << g.lat_deg;
      // And all of them: those of the wide look that reach the small ball.
      std::size_t reach = 0;
      for (const Crater& c : wide) reach += (c.centre - beside).norm() * kMoonRadius_m <= 30 + c.reach_m();
      ASSERT_EQ(some.size(), reach) << g.lat_deg;
    }
  }
}

// --- relief

double height_m(const Relief& relief, int octave, const Vec3& direction) {
  const double around = std::hypot(direction.x(), direction.y());
  const double sin_lat[] = {direction.z()}, cos_lat[] = {around}, sin_lon[] = {direction.y() / around},
               cos_lon[] = {direction.x() / around};
  double height[] = {0};
  relief.add_row(octave, {sin_lat, cos_lat, sin_lon, cos_lon, 0, 1}, 0, height);
  return height[0];
}

TEST(Relief, DeviatesAsTheLawSays) {
  for (const double hurst : {0.8, 0.95}) {
    const Relief relief(
        {.seed = 7, .hurst = hurst, .deviation_m = 0.5, .baseline_m = 10, .longest_m = 4096, .shortest_m = 0.06});
    const auto deviation = [&](double distance_m) {
      double sum = 0;
      constexpr int kPairs = 6000;
      for (int i = 0; i < kPairs; ++i) {
        const double lat = 26 + (i % 100) * 0.013, lon = 3 + (i / 100) * 0.017;
        const auto height = [&](double at) {
          const Vec3 direction = to_cartesian({at, lon, 0}).normalized();
          double h = 0;
          for (int k = relief.smallest_octave(); k <= relief.largest_octave(); ++k) h += height_m(relief, k, direction);
          return h;
        };
        sum += std::pow(height(lat + distance_m / kMetresPerDegree) - height(lat), 2);
      }
      return std::sqrt(sum / kPairs);
    };
    EXPECT_NEAR(deviation(10), 0.5, 0.03);
    EXPECT_NEAR(std::log(deviation(40) / deviation(1)) / std::log(40), hurst, 0.06) << hurst;
  }
}

TEST(Relief, SecondDifferencesAreTheLaws) {
  const Relief relief(
      {.seed = 7, .hurst = 0.9, .deviation_m = 0.5, .baseline_m = 10, .longest_m = 4096, .shortest_m = 0.06});
  for (const double distance_m : {3.0, 10.0, 47.0}) {
    double sum = 0;
    constexpr int kPlaces = 6000;
    for (int i = 0; i < kPlaces; ++i) {
      const double lat = 26 + (i % 100) * 0.013, lon = 3 + (i / 100) * 0.017, apart_deg = distance_m / kMetresPerDegree;
      const auto height = [&](double at) {
        const Vec3 direction = to_cartesian({at, lon, 0}).normalized();
        double h = 0;
        for (int k = relief.smallest_octave(); k <= relief.largest_octave(); ++k) h += height_m(relief, k, direction);
        return h;
      };
      sum += std::pow(height(lat - apart_deg) - 2 * height(lat) + height(lat + apart_deg), 2);
    }
    EXPECT_NEAR(std::sqrt(sum / kPlaces) / relief.second_difference_m(distance_m), 1, 0.06) << distance_m;
  }
}

TEST(Relief, StaysWithinItsBound) {
  const Relief relief({.seed = 1, .hurst = 0.9, .deviation_m = 1, .baseline_m = 10, .longest_m = 64, .shortest_m = 1});
  std::mt19937 random(5);
  std::normal_distribution<double> any;
  double most = 0;
  for (int i = 0; i < 300000; ++i) {
    const Vec3 direction = Vec3(any(random), any(random), any(random)).normalized();
    most = std::max(most, std::abs(height_m(relief, 3, direction)));
  }
  EXPECT_LT(most, relief.max_height_m(3));
  EXPECT_GT(most, 0.6 * relief.max_height_m(3));
}

// --- terrain

double hills(double lat, double lon) {
  return std::round(300 * std::sin(lat * 9) * std::cos(lon * 11) + 20 * std::sin(lon * 130));
}

DetailPreset preset() {
  DetailPreset p;
  p.craters = small_craters(1);
  p.craters.smallest_m = 8;
  p.relief = {.seed = 2, .hurst = 0.9, .deviation_m = 0.3, .baseline_m = 10, .longest_m = 256, .shortest_m = 8};
  return p;
}

struct Ground {
  explicit Ground(double top, double west, double (*height)(double, double) = hills, const Region& region = {}) {
    write_kaguya_tile(folder.path(), top, west, 2, 256, height);
    plain = open_terrain(folder.path());
    DetailPreset p = preset();
    p.region = region;
    detailed = std::make_shared<DetailedTerrain>(plain, std::make_shared<Detail>(p));
  }
  TemporaryFolder folder;
  std::shared_ptr<const PyramidTerrain> plain;
  std::shared_ptr<const DetailedTerrain> detailed;
};

BlockId block_over(int level, double lat_deg, double lon_deg) {
  return block_at(level, static_cast<Tick>((lat_deg + 90) * kTicksPerDegree),
                  static_cast<Tick>((lon_deg + 180) * kTicksPerDegree));
}

// To the bit, whoever is made first: neighbours share their border's heights, and a second service has the same.
void expect_borders_agree(const Terrain& terrain, const Terrain& again, const BlockId& id) {
  const auto here = terrain.block(id), same = again.block(id);
  ASSERT_TRUE(here && same);
  const BlockExtent e = here->extent;
  for (int i = 0; i <= e.quads; ++i)
    for (int k = 0; k <= e.quads; ++k)
      ASSERT_EQ(here->vertices[here->index(i, k)].height_m, same->vertices[same->index(i, k)].height_m);
  for (const auto& [dlat, dlon] :
       {std::pair<Tick, Tick>{-1, 0}, {e.quads * e.lat_step, 0}, {0, -1}, {0, e.quads * e.lon_step}}) {
    const BlockId other_id = block_at(id.level, e.lat0 + dlat, wrap_lon(std::int64_t{e.lon0} + dlon));
    const auto other = terrain.block(other_id);
    ASSERT_TRUE(other) << to_string(other_id);
    const BlockExtent o = other->extent;
    int shared = 0;
    for (int r = 0; r <= e.quads; ++r)
      for (int c = 0; c <= e.quads; ++c) {
        const Tick at_lat = e.lat0 + r * e.lat_step - o.lat0, at_lon = e.lon0 + c * e.lon_step - o.lon0;
        if (at_lat < 0 || at_lon < 0 || at_lat % o.lat_step || at_lon % o.lon_step) continue;
        const int orow = at_lat / o.lat_step, ocol = at_lon / o.lon_step;
        if (orow > o.quads || ocol > o.quads) continue;
        ASSERT_EQ(here->vertices[here->index(r, c)].height_m, other->vertices[other->index(orow, ocol)].height_m)
            << to_string(id) << ' ' << to_string(other_id) << ' ' << r << ' ' << c;
        ++shared;
      }
    EXPECT_GE(shared, e.quads / 2);
  }
}

TEST(DetailedTerrain, BlocksAgreeOnTheirBorders) {
  struct Case {
    double top, west, lat, lon;
    Region region;
  };
  // The last one's border runs through the blocks.
  for (const auto& [top, west, lat, lon, region] :
       {Case{27, 3, 26, 4, {}},
        {76, 20, 75.5, 20.7, {}},
        {-60, -180, -61, -179.2, {}},
        {27, 3, 26, 4, Region({{25.4, 4.1, 0}, {25.4, 4.6, 0}, {25.71, 4.31, 0}, {26, 4.6, 0}, {26, 4.1, 0}})}}) {
    const Ground ground(top, west, hills, region);
    // Most time goes to the posts beneath: a second service makes them anew in two of the cases.
    const auto again =
        top == 27 || test::full_effort() ? std::make_optional<Ground>(top, west, hills, region) : std::nullopt;
    for (int level = 9; level <= 13; ++level)
      if (top == 27 || level % 2 == 1 || test::full_effort())
        expect_borders_agree(*ground.detailed, again ? *again->detailed : *ground.detailed,
                             block_over(level, lat - 0.3, lon + 0.3));
  }
}

// A layer of posts 30 m apart over one of 470 m, and each by itself.
struct Layered {
  Layered() {
    const auto made = [&](const std::string& folder) {
      plain.push_back(open_terrain(folder));
      detailed.push_back(std::make_shared<DetailedTerrain>(plain.back(), std::make_shared<Detail>(preset())));
    };
    write_kaguya_tile(folders[0].path(), 27, 3, 2, 64, hills);
    write_kaguya_tile(folders[1].path(), 26, 4, 1, 1024, hills);
    for (const auto& [top, west, degrees, ppd] : {std::array{27, 3, 2, 64}, {26, 4, 1, 1024}})
      write_kaguya_tile(folders[2].path(), top, west, degrees, ppd, hills);
    for (const TemporaryFolder& folder : folders) made(folder.path());
  }
  const DetailedTerrain& coarse() const { return *detailed[0]; }
  const DetailedTerrain& fine() const { return *detailed[1]; }
  const DetailedTerrain& both() const { return *detailed[2]; }
  std::array<TemporaryFolder, 3> folders;
  std::vector<std::shared_ptr<const PyramidTerrain>> plain;
  std::vector<std::shared_ptr<const DetailedTerrain>> detailed;
};

TEST(DetailedTerrain, EachLayerHasTheDetailOfItsOwnPosts) {
  const Layered layers;
  std::mt19937 random(9);
  std::uniform_real_distribution<double> any(-1, 1);
  // Beyond the band in which the coarse layer is bent, and within the fine layer's outline.
  double added2 = 0;
  const int places = test::cases(500);
  const double spread = test::full_effort() ? 1 : 0.3;  // most time goes to the posts beneath
  for (int i = 0; i < places; ++i) {
    const double lat = 25.5 + spread * 0.3 * any(random), lon = 3.35 + spread * 0.15 * any(random);
    const double height_m = layers.both().height(lat, lon).height_m;
    EXPECT_NEAR(height_m, layers.coarse().height(lat, lon).height_m, 1e-3) << lat << ' ' << lon;
    added2 += std::pow(height_m - layers.plain[2]->height(lat, lon).height_m, 2);
    const double in_lat = 25.5 + spread * 0.45 * any(random), in_lon = 4.5 + spread * 0.45 * any(random);
    EXPECT_NEAR(layers.both().height(in_lat, in_lon).height_m, layers.fine().height(in_lat, in_lon).height_m, 1e-3)
        << in_lat << ' ' << in_lon;
  }
  EXPECT_GT(std::sqrt(added2 / places), 0.5);
  // From one to the other without a step, every metre.
  const auto steepest = [](const Terrain& terrain, double from_lon, double to_lon) {
    double before = std::nan(""), most = 0;
    for (double lon = from_lon; lon < to_lon; lon += 1 / kMetresPerDegree) {
      const double height_m = terrain.height(25.5, lon).height_m;
      if (!std::isnan(before)) most = std::max(most, std::abs(height_m - before));
      before = height_m;
    }
    return most;
  };
  const double across = steepest(layers.both(), 3.96, 4.01);
  EXPECT_LT(across, 1.2 * std::max(steepest(layers.coarse(), 3.96, 4.01), steepest(layers.fine(), 4.4, 4.45)));
}

// Of posts that lie half a post beside the vertices of their level (pixels are areas) as of others; beside them, posts
// that are vertices of the same level, half as far apart.
TEST(DetailedTerrain, BeginsAtTwoPostsOfAnyRegistration) {
  const auto share_at = [](const DetailedTerrain& terrain, int level, double lat, double lon) {
    double sum = 0;
    for (const DetailOfPosts& posts : terrain.detail_at(lat, lon)) sum += posts.level == level ? posts.share : 0;
    return sum;
  };
  for (const double beside : {0.0, 0.5}) {
    SCOPED_TRACE(beside);
    const std::array<TemporaryFolder, 3> folders;
    std::vector<std::shared_ptr<const DetailedTerrain>> of;
    for (std::size_t i = 0; i < folders.size(); ++i) {
      const std::string folder = folders[i].path();
      if (i != 1) test::write_float_tile(folder, "coarse", {28 - beside / 64, 2 + beside / 64, 64, 256, 256}, hills);
      if (i != 0) test::write_float_tile(folder, "fine", {27, 3, 128, 257, 257}, hills);
      of.push_back(std::make_shared<DetailedTerrain>(open_terrain(folder), std::make_shared<Detail>(preset())));
    }
    EXPECT_EQ(share_at(*of[0], 6, 26.01, 4.02), 1);
    EXPECT_EQ(share_at(*of[1], 7, 26.01, 4.02), 1);
    EXPECT_EQ(share_at(*of[2], 7, 26.01, 4.02), 1);
    EXPECT_EQ(share_at(*of[2], 6, 27.51, 2.52), 1);
    for (int i = 0; i < 20; ++i) {
      const double away = 0.01 * i;
      EXPECT_NEAR(of[2]->height(26 + away, 4).height_m, of[1]->height(26 + away, 4).height_m, 1e-3);
      EXPECT_NEAR(of[2]->height(27.4 + away, 2.5).height_m, of[0]->height(27.4 + away, 2.5).height_m, 1e-3);
    }
  }
}

// Posts farther apart than those of the roots' level have the same detail by themselves and beneath finer ones.
TEST(DetailedTerrain, OfFewPostsADegreeIsTheSameBeneathOthers) {
  const std::array<TemporaryFolder, 2> folders;
  std::vector<std::shared_ptr<const DetailedTerrain>> of;
  for (std::size_t i = 0; i < folders.size(); ++i) {
    test::write_float_tile(folders[i].path(), "coarse", {28, 2, 4, 33, 33}, hills);
    if (i == 1) test::write_float_tile(folders[i].path(), "fine", {27, 3, 128, 65, 65}, hills);
    of.push_back(
        std::make_shared<DetailedTerrain>(open_terrain(folders[i].path()), std::make_shared<Detail>(preset())));
  }
  for (int i = 0; i < 20; ++i)
    EXPECT_NEAR(of[1]->height(22 + 0.1 * i, 7).height_m, of[0]->height(22 + 0.1 * i, 7).height_m, 1e-3);
}

TEST(DetailedTerrain, BlocksOfLayersAgreeOnTheirBorders) {
  const Layered here, again;
  int place = 0;
  for (const auto& [lat, lon] :
       {std::pair{25.5, 4.0001}, {25.5, 3.999}, {25.999, 4.001}, {26.001, 3.999}, {25.5, 3.7}}) {
    // Each level beside one place at least.
    for (int level = 7; level <= 13; ++level)
      if (level % 3 == place % 3 || test::full_effort())
        expect_borders_agree(here.both(), again.both(), block_over(level, lat, lon));
    ++place;
  }
}

// To the bit, whether the block is in memory or not.
void expect_quads_of_the_block(const DetailedTerrain& terrain, const DetailedTerrain& again, const BlockId& id) {
  const auto block = again.block(id);
  ASSERT_TRUE(block) << to_string(id);
  const BlockExtent& e = block->extent;
  for (int i = 0; i < e.quads; i += test::full_effort() ? 9 : 21)  // the last is at the far edge
    for (const auto& [r, c] : {std::pair{i, 0}, {0, i}, {i, e.quads - 1}, {e.quads - 1, i}, {i, (7 * i) % e.quads}}) {
      const Tick lat = e.lat0 + r * e.lat_step + e.lat_step / 2, lon = e.lon0 + c * e.lon_step + e.lon_step - 1;
      const auto quad = terrain.block_or_quad(id, lat, lon);
      ASSERT_TRUE(quad);
      ASSERT_EQ(quad->extent.quads, 1);
      for (const int dr : {0, 1})
        for (const int dc : {0, 1}) {
          const float there = quad->vertices[quad->index(dr, dc)].height_m,
                      here = block->vertices[block->index(r + dr, c + dc)].height_m;
          ASSERT_TRUE(there == here || (std::isnan(there) && std::isnan(here)))
              << to_string(id) << ' ' << r << ' ' << c << ' ' << there << ' ' << here;
          ASSERT_EQ(quad->position(dr, dc, 0), block->position(r + dr, c + dc, 0));
        }
      ASSERT_EQ(again.block_or_quad(id, lat, lon), block);
    }
}

// Whoever has the outline of a block needs not make it: heights are within, the error is no smaller.
TEST(DetailedTerrain, OutlinesAreBounds) {
  const Ground ground(27, 3);
  int outlines = 0;
  for (int level = 9; level <= 17; ++level)
    for (const auto& [lat, lon] : {std::pair{26.03, 4.02}, {26.4, 4.7}, {25.2, 3.4}}) {
      const BlockId id = block_over(level, lat, lon);
      EXPECT_FALSE(dem::outline(*ground.plain, id, {}));
      const auto outline = dem::outline(*ground.detailed, id, {});
      if (!outline) continue;
      ++outlines;
      EXPECT_FALSE(ground.plain->blocks().holds(id));
      const NodeInfo made = ground.detailed->node(id);
      EXPECT_LE(outline->min_m, made.min_m) << to_string(id);
      EXPECT_GE(outline->max_m, made.max_m) << to_string(id);
      EXPECT_LE(outline->error_m, made.error_m) << to_string(id);
      EXPECT_EQ(outline->left_out_size_m, made.left_out_size_m) << to_string(id);
    }
  EXPECT_GT(outlines, 12);
}

TEST(DetailedTerrain, QuadsAreThoseOfTheirBlock) {
  const Layered here, again;
  // In the band, at the fine layer's corner and in its middle; outside as well.
  for (const auto& [lat, lon] : {std::pair{25.5, 4.0001}, {25.999, 4.001}, {25.5, 4.5}, {26.001, 3.999}, {25.5, 3.7}}) {
    if (lon < 4 && !test::full_effort()) continue;  // the layer there is as those of single tiles below
    for (const int level : {11, 13})
      if (level == 13 || test::full_effort())
        expect_quads_of_the_block(here.both(), again.both(), block_over(level, lat, lon));
  }
  // The date line from both sides, the south pole, and where the posts' longitude step doubles.
  for (const auto& [top, west, lat, lon] : {std::array{-60.0, -180.0, -61.0, -179.9999},
                                            {-60, 178, -61, 179.9999},
                                            {-88, 20, -90, 20.5},
                                            {76, 20, 75.5, 21}}) {
    const Ground ground(top, west), made(top, west);
    for (const int level : {12, 13})
      if (level == 13 || test::full_effort())
        expect_quads_of_the_block(*ground.detailed, *made.detailed, block_over(level, lat, lon));
  }
}

// At a pole cells of posts are slivers: means taken over them, and from the posts, were rays that meet there.
TEST(DetailedTerrain, ThereAreNoRaysAtAPole) {
  TemporaryFolder folder;
  test::write_global_tile(folder.path(), 4, [](double, double) { return 0.0; });
  DetailPreset p = preset();
  p.relief.longest_m = 8192, p.relief.shortest_m = 512;
  p.craters.largest_m = 1000, p.craters.smallest_m = 256;
  const DetailedTerrain terrain(open_terrain(folder.path()), std::make_shared<Detail>(p));
  const int step_deg = test::full_effort() ? 1 : 9;
  for (const double south : {-89.99, -89.999}) {
    double before_m = terrain.height(south, -step_deg).height_m, steepest = 0;
    const double apart_m = kMetresPerDegree * (90 + south) * kRadiansPerDegree * step_deg;
    for (int lon = 0; lon < 360; lon += step_deg) {
      const double here_m = terrain.height(south, lon).height_m;
      steepest = std::max(steepest, std::abs(here_m - before_m) / apart_m);
      before_m = here_m;
    }
    EXPECT_LT(std::atan(steepest) * kDegreesPerRadian, 12) << south;
    EXPECT_GT(steepest, 0);
  }
}

// Tiles of one layer that touch are one: nothing of the layer beneath shows between them.
TEST(DetailedTerrain, TilesOfALayerHaveNoBorderBetweenThem) {
  const TemporaryFolder fine, both;
  for (const TemporaryFolder* folder : {&fine, &both})
    for (const double west : {3.0, 4.0}) write_kaguya_tile(folder->path(), 27, west, 1, 1024, hills);
  write_kaguya_tile(both.path(), 27, 3, 2, 64, hills);
  const auto detailed = [](const TemporaryFolder& folder) {
    return std::make_shared<DetailedTerrain>(open_terrain(folder.path()), std::make_shared<Detail>(preset()));
  };
  const auto alone = detailed(fine), over = detailed(both);
  for (int i = -30; i <= 30; ++i) {
    const double lat = 26.5 + 1e-3 * i, lon = 4 + i / (16 * 1024.0);
    EXPECT_NEAR(over->height(lat, lon).height_m, alone->height(lat, lon).height_m, 1e-3) << lat << ' ' << lon;
  }
}

CraterSurvey survey_of(const Terrain& terrain) {
  return {terrain, std::make_shared<const CraterRoughness>(terrain.detailed()->detail())};
}

TEST(CraterSurvey, ListsWhatALayerIsTooCoarseFor) {
  const Layered layers;
  const Footprint beside{25.5, 25.55, 3.85, 3.9};
  const auto ids = [&](const Terrain& terrain) {
    std::vector<std::uint64_t> found;
    for (const CraterFeature& f : survey_of(terrain).craters_in(beside, 30, 0, {})) found.push_back(f.crater.id);
    return found;
  };
  const std::vector<std::uint64_t> listed = ids(layers.both());
  EXPECT_GT(listed.size(), 5U);
  EXPECT_EQ(listed, ids(layers.coarse()));

  // Inside the outline there are none of the coarse layer's craters.
  const Footprint inside{25.5, 25.7, 4.01, 4.3};
  EXPECT_GT(survey_of(layers.coarse()).craters_in(inside, 100, 0, {}).size(), 20U);
  EXPECT_TRUE(survey_of(layers.both()).craters_in(inside, 100, 0, {}).empty());
}

// The larger a crater beside the posts' spacing, the more of it their means take; what other craters add to the heights
// has no sign.
TEST(CraterSurvey, DepthsAreWhatPostsLeave) {
  const Ground ground(27, 3);
  constexpr double kPosts_m = 118.4;
  for (const auto& [from, to, least, most] :
       {std::array{0.5, 0.8, 0.9, 1.0}, {0.8, 1.2, 0.8, 0.95}, {1.2, 1.6, 0.6, 0.8}, {1.6, 2.0, 0.4, 0.6}}) {
    SCOPED_TRACE(to);
    double stated_m = 0, measured_m = 0, law_m = 0;
    for (const CraterFeature& f :
         survey_of(*ground.detailed).craters_in({25.8, 26.2, 3.8, 4.2}, from * kPosts_m, 0, {})) {
      if (f.crater.diameter_m >= to * kPosts_m || f.rim_share < 1) continue;
      const auto added_m = [&](const Geographic& g) {
        return ground.detailed->height(g.lat_deg, g.lon_deg).height_m -
               ground.plain->height(g.lat_deg, g.lon_deg).height_m;
      };
      constexpr int kAround = 16;
      double deep_m = -added_m(f.location);
      for (int i = 0; i < kAround; ++i)
        deep_m +=
            added_m(to_geographic(CraterSurvey::on_rim(f.crater, 2 * pi * i / kAround) * kMoonRadius_m)) / kAround;
      stated_m += f.depth_m, measured_m += deep_m, law_m += f.crater.depth_m;
    }
    ASSERT_GT(law_m, 0);
    EXPECT_NEAR(measured_m / stated_m, 1, 0.15);
    EXPECT_GT(stated_m / law_m, least);
    EXPECT_LT(stated_m / law_m, most);
  }
}

// Inside it is the ground that there is without a region, outside the DEM's; craters are those that have their middle
// in it.
TEST(DetailedTerrain, DetailIsInItsRegion) {
  const Region region({{25.8, 3.8, 0}, {25.8, 4.2, 0}, {26.2, 4.2, 0}, {26.2, 3.8, 0}});
  const Ground everywhere(27, 3), within(27, 3, hills, region);
  std::mt19937 random(8);
  std::uniform_real_distribution<double> any(0.2, 1.8);
  int inside = 0, outside = 0, between = 0;
  for (int i = 0; i < test::cases(3200); ++i) {
    // From the region's middle to beyond its western side: most time goes to the posts beneath.
    const double lat = 25 + any(random), lon = 3 + (test::full_effort() ? 1 : 0.62) * any(random);
    const double inside_m = region.inside_m(to_cartesian({lat, lon, 0}).normalized());
    // Most places are between, of which least is known.
    if (inside_m <= 1500 && i % (inside_m < -16000 ? 2 : 5) != 0 && !test::full_effort()) continue;
    const HeightAnswer with = within.detailed->height(lat, lon), plain = within.plain->height(lat, lon);
    const double unlimited_m = everywhere.detailed->height(lat, lon).height_m;
    if (inside_m > 1500) {
      // Craters from outside reach in, and posts are corrected for what is around them.
      EXPECT_NEAR(with.height_m, unlimited_m, 1e-4) << lat << ' ' << lon;
      ++inside;
    } else if (inside_m < -16000) {  // wider than a block of posts
      EXPECT_EQ(with.height_m, plain.height_m) << lat << ' ' << lon;
      ++outside;
    } else {
      EXPECT_LT(std::abs(with.height_m - plain.height_m), 30) << lat << ' ' << lon;
      ++between;
    }
  }
  EXPECT_GT(inside, 15);
  EXPECT_GT(outside, 50);
  EXPECT_GT(between, 50);
  const CraterSurvey all = survey_of(*everywhere.detailed), some = survey_of(*within.detailed);
  const Footprint box{25.7, 25.9, 3.7, 3.9};
  const auto listed = all.craters_in(box, 20, 0, {}), listed_here = some.craters_in(box, 20, 0, {});
  std::vector<std::uint64_t> expected, found;
  for (const CraterFeature& f : listed)
    if (region.holds(f.crater.centre)) expected.push_back(f.crater.id);
  for (const CraterFeature& f : listed_here) {
    EXPECT_TRUE(region.holds(f.crater.centre));
    found.push_back(f.crater.id);
  }
  EXPECT_GT(expected.size(), 30U);
  EXPECT_LT(expected.size(), listed.size() / 2);
  // One that is buried under another from outside is there without that.
  EXPECT_LE(expected.size(), found.size());
  EXPECT_LE(found.size(), expected.size() + expected.size() / 20 + 1);
}

TEST(Region, DistancesAreThoseOnTheSphere) {
  const auto place = [](double lat, double lon) { return to_cartesian({lat, lon, 0}).normalized(); };
  // An octant: its edges are on the equator and on two meridians. 45 degrees from the middle: 54.7.
  const Region octant({{0, 0, 0}, {0, 90, 0}, {90, 0, 0}});
  for (const double lon : {1.0, 30.0, 44.0})
    for (const double lat : {-20.0, -1.0, 0.5, 10.0}) {
      const double to_equator = lat,
                   to_meridian = std::asin(std::cos(lat * kRadiansPerDegree) * std::sin(lon * kRadiansPerDegree)) *
                                 kDegreesPerRadian;
      const double expected = lat < 0 ? to_equator : std::min(to_equator, to_meridian);
      EXPECT_NEAR(octant.inside_m(place(lat, lon)), expected * kRadiansPerDegree * kMoonRadius_m, 1e-3)
          << lat << ' ' << lon;
    }
  EXPECT_NEAR(octant.inside_m(place(-3, -4)),
              -kMoonRadius_m * std::acos(std::cos(3 * kRadiansPerDegree) * std::cos(4 * kRadiansPerDegree)), 1e-3);
  EXPECT_FALSE(octant.holds(place(-45, -135)));  // opposite
  // A pole, the date line, and a corner that points inward.
  const Region pole({{88, 0, 0}, {88, 90, 0}, {88, 180, 0}, {88, -90, 0}});
  EXPECT_TRUE(pole.holds(place(89, 123)) && pole.holds(Vec3::unit_z()) && !pole.holds(place(87.9, 45)));
  const double half_way = std::atan(std::tan(2 * kRadiansPerDegree) * std::sqrt(0.5));
  EXPECT_NEAR(pole.inside_m(Vec3::unit_z()), kMoonRadius_m * half_way, 1e-3);
  const Region dateline({{-1, 179, 0}, {-1, -179, 0}, {0, 179.9, 0}, {1, -179, 0}, {1, 179, 0}});
  EXPECT_TRUE(dateline.holds(place(0, 179.5)) && dateline.holds(place(-0.8, -179.5)));
  EXPECT_FALSE(dateline.holds(place(0, -179.5)));
  EXPECT_TRUE(Region().holds(Vec3::unit_x()));
  EXPECT_EQ(Region().share(Vec3::unit_x(), 100), 1);
  EXPECT_EQ(octant.share(place(-1, 45), 100), 0);
  EXPECT_EQ(octant.share(place(1, 45), 100), 1);
  for (const auto& corners :
       std::vector<std::vector<Geographic>>{{{0, 0, 0}, {0, 1, 0}},                         // two
                                            {{0, 0, 0}, {0, 120, 0}, {0, -120, 0}},         // around the Moon
                                            {{0, 0, 0}, {1, 1, 0}, {0, 1, 0}, {1, 0, 0}},   // crossed
                                            {{0, 0, 0}, {0, 0, 0}, {0, 1, 0}, {1, 0, 0}}})  // twice
    EXPECT_THROW((Region(corners)), std::invalid_argument);
}

// Between a level's vertices and the finest surface lies no more than is said, and all heights are within those that
// are told. `place` gives another place at each call.
template <typename Place>
void expect_bounds_hold(const Terrain& terrain, int finest, const Place& place) {
  for (int level = 5; level < finest; ++level) {
    double tightest = 1e9;
    for (int i = 0; i < (test::full_effort() ? 60 : 20); ++i) {
      const auto [lat, lon] = place();
      const BlockId id = block_over(level, lat, lon);
      const NodeInfo info = terrain.node(id);
      const auto block = terrain.block(id);
      const BlockExtent e = block->extent;
      const double y = ((lat + 90) * kTicksPerDegree - e.lat0) / e.lat_step,
                   x = ((lon + 180) * kTicksPerDegree - e.lon0) / e.lon_step;
      const int r = std::clamp(static_cast<int>(y), 0, e.quads - 1),
                c = std::clamp(static_cast<int>(x), 0, e.quads - 1);
      const auto h = [&](int j, int k) {
        return static_cast<double>(block->vertices[block->index(r + j, c + k)].height_m);
      };
      const double fy = y - r, fx = x - c;
      const double here = fx + fy <= 1 ? h(0, 0) + fx * (h(0, 1) - h(0, 0)) + fy * (h(1, 0) - h(0, 0))
                                       : h(1, 1) + (1 - fx) * (h(1, 0) - h(1, 1)) + (1 - fy) * (h(0, 1) - h(1, 1));
      const double truth = terrain.height(lat, lon).height_m;
      ASSERT_LE(std::abs(here - truth), info.error_m + chord_sag_m(level)) << level;
      ASSERT_GE(truth, static_cast<double>(info.min_m));
      ASSERT_LE(truth, static_cast<double>(info.max_m));
      tightest = std::min(tightest, info.error_m / std::abs(here - truth));
    }
    testing::Test::RecordProperty("tightest_" + std::to_string(level), std::to_string(tightest));
  }
}

TEST(DetailedTerrain, BoundsHold) {
  const Ground ground(27, 3);
  std::mt19937 random(4);
  const double half_deg = test::full_effort() ? 0.7 : 0.3;
  std::uniform_real_distribution<double> any(1 - half_deg, 1 + half_deg);
  const int finest = ground.detailed->finest_level(block_over(8, 26, 4));
  EXPECT_EQ(finest, 14);
  expect_bounds_hold(*ground.detailed, finest, [&] { return std::pair{25 + any(random), 3 + any(random)}; });
}

TEST(DetailedTerrain, BoundsHoldWhereLayersMeet) {
  const Layered layers;
  std::mt19937 random(21);
  std::uniform_real_distribution<double> lat(25.6, 26.02), lon(3.97, 4.15);
  expect_bounds_hold(layers.both(), layers.both().finest_level(block_over(8, 25.9, 4.1)), [&] {
    return std::pair{lat(random), lon(random)};
  });
}

// --- the shipped presets over posts 118 m apart, as deploy/assets/details and dem/detail/laws.md describe them

DetailPreset shipped(const std::string& name) {
  return api::read_detail_file(SELENOGRAPH_SOURCE_DIR "/deploy/assets/details/" + name + ".json");
}

std::string text_of(const std::string& path) {
  std::ifstream file(SELENOGRAPH_SOURCE_DIR + path);
  return {std::istreambuf_iterator<char>(file), {}};
}

// deploy/assets/details.md describes every member that the reader knows, and its example has all of them.
TEST(DetailFiles, AreDescribedMemberByMember) {
  const std::string page = text_of("/deploy/assets/details.md"), reader = text_of("/api/assets/assets.cpp");
  const std::size_t fence = page.find("```json\n");
  ASSERT_NE(fence, std::string::npos);
  const std::string table = page.substr(0, fence), example = page.substr(fence + 8, page.rfind("```") - fence - 8);
  const test::TemporaryFolder folder;
  const std::string path = folder.path() + "/example.json";
  std::ofstream(path) << example;
  EXPECT_NO_THROW(api::read_detail_file(path)) << example;
  const std::size_t first = reader.find("dem::SizeFrequency read_frequency("),
                    past = reader.find("void Assets::refuse_failed");
  ASSERT_LT(first, past);
  const std::string of_details = reader.substr(first, past - first);
  const std::regex list(R"(object\(\{([^}]*)\}\))"), quoted(R"re("(\w+)")re");
  int members = 0;
  for (std::sregex_iterator object(of_details.begin(), of_details.end(), list), end; object != end; ++object) {
    const std::string names = (*object)[1];
    for (std::sregex_iterator name(names.begin(), names.end(), quoted); name != end; ++name, ++members) {
      EXPECT_NE(table.find((*name)[1].str()), std::string::npos) << (*name)[1];
      EXPECT_NE(example.find("\"" + (*name)[1].str() + "\":"), std::string::npos) << (*name)[1];
    }
  }
  EXPECT_GT(members, 20);
}

// On level ground, so that heights are the detail's.
struct GroundOf {
  GroundOf(const DetailPreset& preset, int top_lat_deg) {
    write_kaguya_tile(folder.path(), top_lat_deg, 3, 2, 256, [](double, double) { return 0; });
    detailed = std::make_shared<DetailedTerrain>(open_terrain(folder.path()), std::make_shared<Detail>(preset));
  }
  TemporaryFolder folder;
  std::shared_ptr<const DetailedTerrain> detailed;
};

// The DEM stays true: over each post's cell the ground with detail has the mean that it has without, here 0. Cells of
// 118 m by the latitude's share of that. Octaves below 8 m are left out: their means are millimetres.
struct CellMeans {
  double rms_m, worst_m;
};

CellMeans means_over_cells(const std::string& name) {
  constexpr int kPosts = 8, kFiner = 6, kQuads = 64, kBlocks = 15, kPlaces = 1 << kFiner, kSide = kBlocks * kQuads;
  double squares = 0, worst = 0, detail_squares = 0;
  int cells = 0, places = 0;
  DetailPreset preset = shipped(name);
  preset.relief.min_factor = 1;  // as on rough posts
  for (const auto& [top, lon] :
       {std::pair{1, 3.3}, {1, 4.5}, {27, 3.3}, {27, 4.1}, {61, 3.5}, {61, 4.4}, {81, 3.3}, {81, 4.2}}) {
    if (lon > 4 && !test::full_effort()) continue;  // each latitude once
    const GroundOf ground(preset, top);
    const BlockId first = block_over(kPosts + kFiner, top - 0.7, lon);
    std::vector<double> heights_m(static_cast<std::size_t>((kSide + 1) * (kSide + 1)));
    const auto height_m = [&](int r, int c) -> double& {
      return heights_m[static_cast<std::size_t>(r * (kSide + 1) + c)];
    };
    for (int i = 0; i < kBlocks * kBlocks; ++i) {
      const int row = i / kBlocks, col = i % kBlocks;
      const auto block = ground.detailed->block({first.level, first.row + row, first.col + col});
      if (!block) throw std::runtime_error("no block");
      for (int r = 0; r <= kQuads; ++r)
        for (int c = 0; c <= kQuads; ++c)
          height_m(row * kQuads + r, col * kQuads + c) =
              static_cast<double>(block->vertices[block->index(r, c)].height_m);
    }
    for (int r = kPlaces; r < kSide; r += kPlaces)
      for (int c = kPlaces; c < kSide; c += kPlaces) {
        double sum = 0;
        for (int y = -kPlaces / 2; y <= kPlaces / 2; ++y)
          for (int x = -kPlaces / 2; x <= kPlaces / 2; ++x) {
            const auto share = [](int k) { return std::abs(k) == kPlaces / 2 ? 0.5 : 1.0; };
            const double here_m = height_m(r + y, c + x);
            sum += share(x) * share(y) * here_m;
            detail_squares += here_m * here_m, ++places;
          }
        const double mean = sum / (kPlaces * kPlaces);
        squares += mean * mean, worst = std::max(worst, std::abs(mean)), ++cells;
      }
  }
  EXPECT_EQ(cells, (test::full_effort() ? 8 : 4) * 196);
  const double rms = std::sqrt(squares / cells);
  std::printf("%s: means over %d cells: rms %.3f m, worst %.2f m; the detail: rms %.2f m\n", name.c_str(), cells, rms,
              worst, std::sqrt(detail_squares / places));
  return {rms, worst};
}

// dem/detail/laws.md says so. Whole metres are off by 0.29 m (RMS) and 0.5 m.
TEST(DetailedTerrain, MeansOverThePostsCellsAreTheDems) {
  const CellMeans mare = means_over_cells("mare"), highlands = means_over_cells("highlands");
  EXPECT_LT(mare.rms_m, 0.02);
  EXPECT_LT(mare.worst_m, 0.15);
  EXPECT_LT(highlands.rms_m, 0.04);
  EXPECT_LT(highlands.worst_m, 0.15);
}

// --- relief that follows the roughness of the posts

// Second differences of the law of `preset()` over two posts are those of white noise of this deviation.
double noise_as_rough_m() { return Relief(preset().relief).second_difference_m(2 * post_spacing_m(8)) / std::sqrt(6); }

// White noise, nearly level in the west at 3 degrees, as rough as the law at 4 degrees, twice as rough at 5.
double rougher_to_the_east(double lat, double lon) {
  static const double as_rough_m = noise_as_rough_m();
  const auto number = [](double deg) { return static_cast<std::uint64_t>(std::lround(deg * 256)); };
  const std::uint64_t bits = split_mix(split_mix(kSplitMixStep * number(lat)) + kSplitMixStep * number(lon));
  const double uniform = static_cast<double>(bits >> 11) * 0x1p-53;
  return std::round(as_rough_m * (lon - 3) * std::sqrt(12) * (uniform - 0.5));
}

struct ReliefOnPosts {
  ReliefOnPosts(const ReliefLaw& law, const CraterLaw& craters) {
    write_kaguya_tile(folder.path(), 27, 3, 2, 256, rougher_to_the_east);
    plain = open_terrain(folder.path());
    DetailPreset p;
    p.relief = law;
    p.craters = craters;
    detailed = std::make_shared<DetailedTerrain>(plain, std::make_shared<Detail>(p));
  }
  TemporaryFolder folder;
  std::shared_ptr<const PyramidTerrain> plain;
  std::shared_ptr<const DetailedTerrain> detailed;
};

ReliefLaw following(double min_factor) {
  ReliefLaw law = preset().relief;
  law.min_factor = min_factor;
  return law;
}

ReliefLaw hardly_any() {
  ReliefLaw law = preset().relief;
  law.deviation_m = 1e-6;
  return law;
}

TEST(DetailedTerrain, ReliefFollowsTheRoughnessOfThePosts) {
  constexpr double kLeast = 0.2;
  const ReliefOnPosts follows(following(kLeast), {}), constant(following(1), {}), smooth(hardly_any(), {});
  // Returns the relief's RMS around a meridian over that of the same relief with constant amplitudes.
  const auto factor = [&](double lon_deg) {
    double followed = 0, whole = 0;
    for (int i = 0; i < 400; ++i) {
      const double lat = 25.3 + 1.4 * (i % 20) / 20, lon = lon_deg + 0.05 * (i / 20 - 10) / 20;
      const auto height_m = [&](const ReliefOnPosts& terrain) { return terrain.detailed->height(lat, lon).height_m; };
      const double surface_m = height_m(smooth);
      followed += std::pow(height_m(follows) - surface_m, 2);
      whole += std::pow(height_m(constant) - surface_m, 2);
    }
    return std::sqrt(followed / whole);
  };
  EXPECT_NEAR(factor(3.06), kLeast, 0.01);
  EXPECT_NEAR(factor(3.5), 0.5, 0.05);
  EXPECT_NEAR(factor(3.8), 0.8, 0.06);
  EXPECT_NEAR(factor(4.8), 1, 1e-6);
}

// As MeansOverThePostsCellsAreTheDems, where the amplitude changes from cell to cell.
TEST(DetailedTerrain, MeansOverCellsHoldWhereReliefFollowsThePosts) {
  constexpr int kFiner = 5, kQuads = 64, kBlocks = 6, kPlaces = 1 << kFiner, kSide = kBlocks * kQuads;
  ReliefLaw law = shipped("highlands").relief;
  law.min_factor = 0.1;
  law.shortest_m = 8;
  const ReliefOnPosts follows(law, {}), smooth(hardly_any(), {});
  const BlockId first = block_over(8 + kFiner, 26.1, 3.6);
  std::vector<double> detail_m(static_cast<std::size_t>((kSide + 1) * (kSide + 1)));
  const auto at = [&](int r, int c) -> double& { return detail_m[static_cast<std::size_t>(r * (kSide + 1) + c)]; };
  double squares = 0, worst = 0, detail_squares = 0;
  for (int i = 0; i < kBlocks * kBlocks; ++i) {
    const BlockId id{first.level, first.row + i / kBlocks, first.col + i % kBlocks};
    const auto with = follows.detailed->block(id), without = smooth.detailed->block(id);
    ASSERT_TRUE(with && without);
    for (int r = 0; r <= kQuads; ++r)
      for (int c = 0; c <= kQuads; ++c) {
        const std::size_t post = with->index(r, c);
        at(i / kBlocks * kQuads + r, i % kBlocks * kQuads + c) =
            static_cast<double>(with->vertices[post].height_m) - static_cast<double>(without->vertices[post].height_m);
      }
  }
  int cells = 0;
  for (int r = kPlaces; r < kSide; r += kPlaces)
    for (int c = kPlaces; c < kSide; c += kPlaces) {
      double sum = 0;
      for (int y = -kPlaces / 2; y <= kPlaces / 2; ++y)
        for (int x = -kPlaces / 2; x <= kPlaces / 2; ++x) {
          const auto share = [](int k) { return std::abs(k) == kPlaces / 2 ? 0.5 : 1.0; };
          sum += share(x) * share(y) * at(r + y, c + x);
          detail_squares += at(r + y, c + x) * at(r + y, c + x) / (kPlaces * kPlaces);
        }
      const double mean = sum / (kPlaces * kPlaces);
      squares += mean * mean;
      worst = std::max(worst, std::abs(mean));
      ++cells;
    }
  EXPECT_GT(std::sqrt(detail_squares / cells), 0.15);  // the law's 2.6 m times factors of 0.1 to 0.2
  EXPECT_LT(std::sqrt(squares / cells), 0.01);
  EXPECT_LT(worst, 0.04);
}

TEST(DetailedTerrain, BordersAndBoundsHoldWhereReliefFollowsThePosts) {
  const ReliefOnPosts here(following(0.2), preset().craters), again(following(0.2), preset().craters);
  for (const int level : {9, 11, 13})
    expect_borders_agree(*here.detailed, *again.detailed, block_over(level, 25.98, 3.51));
  std::mt19937 random(4);
  const double half_deg = test::full_effort() ? 0.7 : 0.3;
  std::uniform_real_distribution<double> any(1 - half_deg, 1 + half_deg);
  expect_bounds_hold(*here.detailed, here.detailed->finest_level(block_over(8, 26, 4)), [&] {
    return std::pair{25 + any(random), 3 + any(random)};
  });
}

// How second differences of heights grow from a quarter of a post to 8 posts: the power from each distance to the next
// double one. At so many places along meridians.
std::vector<double> growth(const Terrain& terrain, const Geographic& middle, double wide_deg, double post_m,
                           int places) {
  std::vector<double> powers;
  double before = 0;
  for (const double posts : {0.25, 0.5, 1.0, 2.0, 4.0, 8.0}) {
    const double apart_deg = posts * post_m / kMetresPerDegree;
    double sum = 0;
    for (int i = 0; i < places; ++i) {
      const double lat = middle.lat_deg + wide_deg * (std::fmod(0.5 + i * 0.7548776662466927, 1.0) - 0.5),
                   lon = middle.lon_deg + wide_deg / std::cos(lat * kRadiansPerDegree) *
                                              (std::fmod(0.5 + i * 0.5698402909980532, 1.0) - 0.5);
      const auto height_m = [&](double at) { return terrain.height(at, lon).height_m; };
      const double second = height_m(lat - apart_deg) - 2 * height_m(lat) + height_m(lat + apart_deg);
      sum += second * second;
    }
    if (before > 0) powers.push_back(std::log2(sum / before) / 2);
    before = sum;
  }
  return powers;
}

// The spectra of a DEM and its detail join: no dip where the DEM has too little (its surface is smooth: the power 2
// above, and next to none below), no bump.
TEST(DetailedTerrain, JoinsTheSpectrumOfItsDem) {
  struct Site {
    const char *dem, *preset;
    Geographic middle;
    double wide_deg, post_m, smallest_m;
    int resolved;
  };
  for (const Site& site :
       {Site{"hadley", "highlands", {25.6, 3, 0}, 0.8, 118.45, 16, 8},
        Site{"real/NPC_final_adj_5mpp_surf_piece_2km_2_1.tif", "mare", {-84.809, 125.96, 0}, 0.04, 5, 1, 1}}) {
    const std::string files = test::shared_data(site.dem);
    SELENOGRAPH_SKIP_WITHOUT(files);
    DetailPreset preset = shipped(site.preset);
    preset.craters.smallest_m = preset.relief.shortest_m = site.smallest_m;
    const auto detail = std::make_shared<const Detail>(preset);
    for (const bool told : {true, false}) {
      if (!told && site.resolved == 1) continue;  // there is nothing to tell
      Catalogue catalogue(std::vector<std::string>{files});
      if (told) {
        ASSERT_EQ(resolve_posts(catalogue, {{"*", std::nullopt}}).front().posts, site.resolved) << site.dem;
      }
      const auto plain = std::make_shared<PyramidTerrain>(std::move(catalogue), TerrainOptions{{}, 512UL << 20, false});
      // The real one's threshold is near: fewer places are not enough there.
      const int places = site.resolved == 1 || test::full_effort() ? 300 : 75;
      const std::vector<double> powers =
          growth(DetailedTerrain(plain, detail), site.middle, site.wide_deg, site.post_m, places);
      const auto [least, most] = std::minmax_element(powers.begin(), powers.end());
      if (told || site.resolved == 1) {
        EXPECT_GT(*least, 0.6) << site.dem;
        EXPECT_LT(*most, site.resolved == 1 ? 1.7 : 1.4) << site.dem;  // the piece itself has 1.6 over 4 posts
      } else {
        EXPECT_LT(*least, 0.5) << site.dem;
        EXPECT_GT(*most, 1.5) << site.dem;
      }
    }
  }
}

// Blocks of the posts' own level and coarser ones have detail, too, where the posts resolve less.
TEST(DetailedTerrain, BoundsAndBordersHoldBelowThePostsLevel) {
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 27, 3, 2, 256, hills);
  const auto made = [&] {
    Catalogue catalogue(std::vector<std::string>{folder.path()});
    resolve_posts(catalogue, {{"*", 4}});
    return std::make_shared<DetailedTerrain>(
        std::make_shared<PyramidTerrain>(std::move(catalogue), TerrainOptions{{}, 512UL << 20, false}),
        std::make_shared<Detail>(preset()));
  };
  const auto terrain = made(), again = made();
  EXPECT_FALSE(has_detail(*terrain, block_over(6, 26, 4)));
  EXPECT_EQ(terrain->detail_at(26, 4).front().level, 6);
  for (const int level : {7, 8, 9, 11}) {
    EXPECT_TRUE(has_detail(*terrain, block_over(level, 26, 4)));
    EXPECT_FALSE(has_detail(terrain->plain(), block_over(level, 26, 4)));
    expect_borders_agree(*terrain, *again, block_over(level, 25.98, 4.01));
  }
  std::mt19937 random(4);
  const double half_deg = test::full_effort() ? 0.7 : 0.3;
  std::uniform_real_distribution<double> any(1 - half_deg, 1 + half_deg);
  expect_bounds_hold(*terrain, terrain->finest_level(block_over(8, 26, 4)), [&] {
    return std::pair{25 + any(random), 3 + any(random)};
  });
}

}  // namespace
}  // namespace selenograph::dem
