// Errors of a lander's map: statistics of the random fields, and what maps, rays and heights show of each error.
#include "dem/map_error/map_error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "dem/map_error/gaussian_field.h"
#include "dem/map_error/map_error_terrain.h"
#include "dem/map_error/surface_error.h"
#include "dem/terrain/surface_place.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/vec_text.h"

namespace selenograph::dem {
namespace {

using test::open_terrain;
using test::TemporaryFolder;

Vec3 direction_of(double lat_deg, double lon_deg) { return to_cartesian({lat_deg, lon_deg, 0}) / kMoonRadius_m; }

// Directions uniform over the sphere, always the same ones.
std::vector<Vec3> random_directions(int count, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<Vec3> directions;
  for (int i = 0; i < count; ++i)
    directions.push_back(Vec3(normal(random), normal(random), normal(random)).normalized());
  return directions;
}

// Returns the direction at a distance along the surface, toward an azimuth from a fixed axis.
Vec3 displaced(const Vec3& direction, double distance_m, double azimuth) {
  const Vec3 a = direction.unit_orthogonal(), b = direction.cross(a);
  return (direction + distance_m / kMoonRadius_m * (std::cos(azimuth) * a + std::sin(azimuth) * b)).normalized();
}

struct Moments {
  double mean = 0, deviation = 0, kurtosis = 0;
};

Moments moments_of(const std::vector<double>& values) {
  Moments m;
  const auto n = static_cast<double>(values.size());
  for (const double v : values) m.mean += v / n;
  double square = 0, fourth = 0;
  for (const double v : values) {
    const double d = (v - m.mean) * (v - m.mean);
    square += d / n;
    fourth += d * d / n;
  }
  m.deviation = std::sqrt(square);
  m.kurtosis = fourth / (square * square);
  return m;
}

double correlation_of(const std::vector<double>& a, const std::vector<double>& b) {
  const Moments of_a = moments_of(a), of_b = moments_of(b);
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - of_a.mean) * (b[i] - of_b.mean);
  return sum / static_cast<double>(a.size()) / (of_a.deviation * of_b.deviation);
}

std::vector<double> values_at(const GaussianField& field, const std::vector<Vec3>& directions) {
  GaussianField::Cursor cursor;
  std::vector<double> values;
  for (const Vec3& d : directions) values.push_back(field.at(kMoonRadius_m * d, cursor).value);
  return values;
}

// With 40 000 independent places the standard error of the mean is 0.005 deviations, of the deviation 0.0035, of the
// kurtosis 0.025, of a correlation at most 0.005: limits are at four of them.
constexpr int kPlaces = 40000;

TEST(GaussianField, HasItsMomentsOverTheSphere) {
  const Moments m = moments_of(values_at(GaussianField(3, 500, 7), random_directions(kPlaces, 1)));
  EXPECT_NEAR(m.mean, 0, 3 * 0.02);
  EXPECT_NEAR(m.deviation, 3, 3 * 0.014);
  EXPECT_NEAR(m.kurtosis, 3, 0.1);
}

TEST(GaussianField, CorrelationFallsAsDocumented) {
  const GaussianField field(2, 800, 3);
  const std::vector<Vec3> places = random_directions(kPlaces, 2);
  const std::vector<double> here = values_at(field, places);
  for (const double lengths : {0.25, 0.5, 1.0, 1.5, 3.0})
    for (const double azimuth : {0.0, 0.8, 1.9}) {
      std::vector<Vec3> there;
      for (const Vec3& d : places) there.push_back(displaced(d, lengths * 800, azimuth));
      EXPECT_NEAR(correlation_of(here, values_at(field, there)), std::exp(-lengths * lengths), 0.008 + 0.02)
          << lengths << ' ' << azimuth;
    }
}

// The ensemble at one place: a pole, where longitudes end, an axis of the lattice, and elsewhere.
TEST(GaussianField, EveryPlaceIsTheSameInTheEnsemble) {
  constexpr int kSeeds = 20000;  // standard error of the deviation: 0.005
  for (const Vec3& d : {direction_of(90, 0), direction_of(-90, 0), direction_of(0, 180), direction_of(0, 0),
                        direction_of(31.7, 77.7)}) {
    std::vector<double> values, beside;
    for (int seed = 0; seed < kSeeds; ++seed) {
      const GaussianField field(1, 500, static_cast<std::uint64_t>(seed));
      GaussianField::Cursor cursor;
      values.push_back(field.at(kMoonRadius_m * d, cursor).value);
      beside.push_back(field.at(kMoonRadius_m * displaced(d, 500, 0.4), cursor).value);
    }
    EXPECT_NEAR(moments_of(values).mean, 0, 0.028) << d;
    EXPECT_NEAR(moments_of(values).deviation, 1, 0.02) << d;
    EXPECT_NEAR(correlation_of(values, beside), std::exp(-1), 0.008 + 0.028) << d;
  }
}

TEST(GaussianField, SeedsAreIndependent) {
  const std::vector<Vec3> places = random_directions(kPlaces, 4);
  const std::vector<double> first = values_at(GaussianField(1, 500, 1), places);
  for (const std::uint64_t other : {0ULL, 2ULL, 3ULL, 1ULL << 32, 1ULL << 52})
    EXPECT_NEAR(correlation_of(first, values_at(GaussianField(1, 500, other), places)), 0, 0.02) << other;
}

TEST(GaussianField, GradientIsTheDifferenceQuotient) {
  const GaussianField field(5, 300, 9);
  GaussianField::Cursor cursor;
  constexpr double kStep_m = 0.01;
  for (const Vec3& d : random_directions(200, 5)) {
    const Vec3 p = kMoonRadius_m * d, gradient = field.at(p, cursor).gradient;
    for (int axis = 0; axis < 3; ++axis) {
      const Vec3 step = kStep_m * Mat3::identity().col(axis);
      const double quotient = (field.at(p + step, cursor).value - field.at(p - step, cursor).value) / (2 * kStep_m);
      EXPECT_NEAR(gradient[axis], quotient, 1e-7);
    }
  }
}

// Values do not depend on the places that a cursor has seen before.
TEST(GaussianField, CursorsChangeNothing) {
  const GaussianField field(1, 400, 11);
  const std::vector<Vec3> places = random_directions(500, 6);
  const std::vector<double> in_order = values_at(field, places);
  for (std::size_t i = 0; i < places.size(); ++i) {
    GaussianField::Cursor fresh;
    EXPECT_EQ(field.at(kMoonRadius_m * places[i], fresh).value, in_order[i]);
  }
}

double wave_m(double lat_deg, double lon_deg) { return 700 * std::sin(9 * lat_deg) * std::cos(7 * lon_deg); }

class MapErrorOnWaves : public ::testing::Test {
 protected:
  // Posts 474 m apart: from 6 to 10 degrees north and 20 to 24 east, from 74 to 78 north and 0 to 8 east, and around
  // the south pole.
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    test::write_float_tile(folder_->path(), "wave", {10, 20, 64, 257, 257}, wave_m);
    test::write_float_tile(folder_->path(), "border", {78, 0, 64, 257, 513}, wave_m);
    test::write_float_tile(folder_->path(), "pole", {-88, 0, 64, 129, 64 * 360},
                           [](double lat_deg, double) { return 300 * std::sin(9 * lat_deg); });
    truth_ = new std::shared_ptr<const PyramidTerrain>(open_terrain(folder_->path()));
  }
  static void TearDownTestSuite() {
    delete truth_;
    delete folder_;
    truth_ = nullptr;
    folder_ = nullptr;
  }
  static const PyramidTerrain& truth() { return **truth_; }
  static MapErrorTerrain map_of(const MapError& error) { return {*truth_, error}; }

  static std::vector<Geographic> places(int count) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> lat(6.6, 9.4), lon(20.6, 23.4);
    std::vector<Geographic> found;
    for (int i = 0; i < count; ++i) found.push_back({lat(random), lon(random), 0});
    return found;
  }

 private:
  static inline TemporaryFolder* folder_ = nullptr;
  static inline std::shared_ptr<const PyramidTerrain>* truth_ = nullptr;
};

TEST_F(MapErrorOnWaves, NoErrorIsTheTerrain) {
  const MapErrorTerrain map = map_of({});
  for (const Geographic& p : places(300)) {
    const HeightAnswer wrong = map.height(p.lat_deg, p.lon_deg), right = truth().height(p.lat_deg, p.lon_deg);
    EXPECT_EQ(wrong.height_m, right.height_m);
    EXPECT_EQ(wrong.source, right.source);
  }
}

TEST_F(MapErrorOnWaves, HeightErrorsHaveTheirStatistics) {
  MapError error;
  error.seed = 5;
  error.height = {{4, 300}, {3, 2000}};
  const MapErrorTerrain map = map_of(error);
  std::vector<double> differences;
  for (const Geographic& p : places(3000))
    differences.push_back(map.height(p.lat_deg, p.lon_deg).height_m - truth().height(p.lat_deg, p.lon_deg).height_m);
  // The area, 85 km wide, has some 1000 independent values of the second field.
  EXPECT_NEAR(moments_of(differences).mean, 0, 0.5);
  EXPECT_NEAR(moments_of(differences).deviation, 5, 0.3);
  error.seed = 6;
  const MapErrorTerrain other = map_of(error);
  std::vector<double> others;
  for (const Geographic& p : places(3000))
    others.push_back(other.height(p.lat_deg, p.lon_deg).height_m - truth().height(p.lat_deg, p.lon_deg).height_m);
  EXPECT_NEAR(correlation_of(differences, others), 0, 0.1);
}

TEST_F(MapErrorOnWaves, ScaleIsAboutAHeight) {
  MapError error;
  error.scale = 1.05;
  error.about.height_m = -400;
  const MapErrorTerrain map = map_of(error);
  for (const Geographic& p : places(300)) {
    const double right_m = truth().height(p.lat_deg, p.lon_deg).height_m;
    EXPECT_NEAR(map.height(p.lat_deg, p.lon_deg).height_m, -400 + 1.05 * (right_m + 400), 1e-3);
  }
}

TEST_F(MapErrorOnWaves, TiltRisesTowardItsAzimuth) {
  MapError error;
  error.about = {8, 22, 0};
  error.tilt = {0.1, 60};
  const MapErrorTerrain map = map_of(error);
  const EastNorthUp axes = local_axes(8, 22);
  const double rise = std::tan(0.1 * kRadiansPerDegree);
  for (const double azimuth_deg : {0.0, 60.0, 150.0, 240.0, 300.0}) {
    const double azimuth = azimuth_deg * kRadiansPerDegree;
    constexpr double kDistance_m = 20000;
    const Vec3 offset_m = kDistance_m * (std::sin(azimuth) * axes.east + std::cos(azimuth) * axes.north);
    const Geographic p = to_geographic((kMoonRadius_m * axes.up + offset_m).normalized() * kMoonRadius_m);
    const double added_m = map.height(p.lat_deg, p.lon_deg).height_m - truth().height(p.lat_deg, p.lon_deg).height_m;
    const double expected_m = rise * kDistance_m * std::cos((azimuth_deg - 60) * kRadiansPerDegree);
    EXPECT_NEAR(added_m, expected_m, 0.003 * rise * kDistance_m + 0.01) << azimuth_deg;
  }
}

// East of its true place, the map shows the ground of that place.
TEST_F(MapErrorOnWaves, ShiftDisplacesTheGround) {
  MapError error;
  error.about = {8, 22, 0};
  error.shift = {-900, 1700};
  const MapErrorTerrain map = map_of(error);
  const EastNorthUp axes = local_axes(8, 22);
  double worst_m = 0;
  for (const Geographic& p : places(300)) {
    // A rotation about the axis up x shift by Rodrigues' formula.
    const Vec3 d = direction_of(p.lat_deg, p.lon_deg), shift_m = 1700 * axes.east - 900 * axes.north;
    const Vec3 k = axes.up.cross(shift_m).normalized();
    const double angle = shift_m.norm() / kMoonRadius_m;
    const Vec3 shown = d * std::cos(angle) + k.cross(d) * std::sin(angle) + k * k.dot(d) * (1 - std::cos(angle));
    const Geographic at = to_geographic(shown * kMoonRadius_m);
    worst_m = std::max(
        worst_m, std::abs(map.height(at.lat_deg, at.lon_deg).height_m - truth().height(p.lat_deg, p.lon_deg).height_m));
  }
  // Triangles of half the spacing cut what posts 474 m apart leave of the wave's curvature: 700 m (9 / degree)^2 d^2
  // / 8.
  EXPECT_LT(worst_m, 1.8);
  const double east_deg = 1700 / (kMetresPerDegree * std::cos(8 * kRadiansPerDegree));
  const double north_deg = -900 / kMetresPerDegree;
  EXPECT_NEAR(map.height(8 + north_deg, 22 + east_deg).height_m, truth().height(8, 22).height_m, 1.8);
}

TEST_F(MapErrorOnWaves, ResolutionShowsACoarserLevel) {
  MapError error;
  error.resolution_m = 900;
  const MapErrorTerrain map = map_of(error);
  const int level = 5;  // 948 m
  ASSERT_GE(post_spacing_m(level), 900);
  ASSERT_LT(post_spacing_m(level + 1), 900);
  for (const Geographic& p : places(300)) {
    const auto coarse = surface_at(truth(), p.lat_deg, p.lon_deg, level);
    ASSERT_TRUE(coarse);
    // Chords of posts 948 m apart lie up to 0.13 m below the subdivided surface, which follows the sphere.
    EXPECT_NEAR(map.height(p.lat_deg, p.lon_deg).height_m, coarse->height_m, 0.15);
  }
}

MapError all_errors() {
  MapError error;
  error.seed = 3;
  error.about = {8, 22, 100};
  error.height = {{4, 400}};
  error.albedo = {{0.05, 700}};
  error.shift = {300, -450};
  error.scale = 0.98;
  error.tilt = {0.05, 200};
  return error;
}

// Normals follow from the heights' gradients: compare with those of a lattice of heights.
TEST_F(MapErrorOnWaves, NormalsAreThoseOfTheHeights) {
  MapError error = all_errors();
  error.shift = {};
  const SurfaceError surface(error);
  const StopToken never;
  SurfaceError::Cursors cursors = surface.cursors(never);
  constexpr double kStep_m = 0.5;
  for (const Geographic& p : places(100)) {
    const Vec3 up = direction_of(p.lat_deg, p.lon_deg);
    const EastNorthUp axes = local_axes(up);
    // A plane of slope 0.1 to the east at the place, as the true ground.
    const auto ground = [&](double east_m) {
      return SurfaceError::Ground{50 + 0.1 * east_m, (axes.up - 0.1 * axes.east).normalized(), 1};
    };
    const auto point_at = [&](double east_m, double north_m) -> Vec3 {
      const Vec3 d = (kMoonRadius_m * up + east_m * axes.east + north_m * axes.north).normalized();
      return (kMoonRadius_m + surface.apply(d, ground(east_m), cursors).height_m) * d;
    };
    const Vec3 by_heights =
        (point_at(kStep_m, 0) - point_at(-kStep_m, 0)).cross(point_at(0, kStep_m) - point_at(0, -kStep_m)).normalized();
    EXPECT_LT((surface.apply(up, ground(0), cursors).normal - by_heights).norm(), 2e-5);
  }
}

// Bounds of nodes hold for the blocks of all levels, with a shift and without one.
TEST_F(MapErrorOnWaves, NodesBoundTheirGround) {
  for (const bool shifted : {false, true}) {
    MapError error = all_errors();
    if (!shifted) error.shift = {};
    const MapErrorTerrain map = map_of(error);
    for (int level = 2; level <= 9; ++level)
      for (const Geographic& p : places(12)) {
        const BlockId id = block_at_place(level, p.lat_deg, p.lon_deg);
        const NodeInfo info = map.node(id);
        const auto block = map.block(id);
        ASSERT_TRUE(block);
        for (const Vertex& v : block->vertices) {
          if (std::isnan(v.height_m)) continue;
          ASSERT_GE(v.height_m, info.min_m) << level;
          ASSERT_LE(v.height_m, info.max_m) << level;
        }
        const auto coarse = surface_at(map, p.lat_deg, p.lon_deg, level);
        ASSERT_TRUE(coarse);
        EXPECT_NEAR(coarse->height_m, map.height(p.lat_deg, p.lon_deg).height_m,
                    info.error_m + chord_sag_m(std::min(level, map.finest_level(id))) + 0.01)
            << level;
      }
  }
}

TEST_F(MapErrorOnWaves, BlocksMeetAtTheirEdges) {
  const MapErrorTerrain map = map_of(all_errors());
  for (int level = 6; level <= 9; ++level) {
    const BlockId west = block_at_place(level, 8.1, 22.1), east{level, west.row, west.col + 1};
    const auto a = map.block(west), b = map.block(east);
    ASSERT_TRUE(a && b);
    for (int r = 0; r < a->side(); ++r) {
      const Vertex& left = a->vertices[a->index(r, a->side() - 1)];
      const Vertex& right = b->vertices[b->index(r, 0)];
      EXPECT_EQ(left.height_m, right.height_m);
      EXPECT_LT((left.normal - right.normal).norm(), 1e-5F);
    }
  }
}

// Toward a pole rows of posts differ in their spacing in longitude. Where the map's posts are coarser than the true
// ones, blocks to both sides of such a border have the same ground on it.
TEST_F(MapErrorOnWaves, CoarserPostsMeetWhereTheirSpacingChanges) {
  MapError error;
  error.resolution_m = 900;
  const MapErrorTerrain map = map_of(error);
  constexpr int kLevel = 8, kPostsLevel = 5;
  const auto shift_at = [&](Tick lat) { return lon_shift(kPostsLevel, block_at(kPostsLevel, lat, 0).row); };
  int borders = 0;
  const int first = block_at_place(kLevel, 74.5, 4).row, last = block_at_place(kLevel, 77.5, 4).row;
  for (int row = first; row < last; ++row) {
    const Tick border = extent_of({kLevel, row + 1, 0}).lat0;
    if (shift_at(border - 1) == shift_at(border)) continue;
    ++borders;
    const auto below = map.block(block_at(kLevel, border - 1, 184 * kTicksPerDegree));
    ASSERT_TRUE(below);
    int compared = 0;
    for (int c = 0; c < below->side(); ++c) {
      const Tick lon = below->extent.lon0 + c * below->extent.lon_step;
      const auto above = map.block(block_at(kLevel, border, lon));
      ASSERT_TRUE(above);
      const auto height_m = post_at(*above, border, lon);
      if (!height_m) continue;
      ++compared;
      EXPECT_EQ(*height_m, below->vertices[below->index(below->side() - 1, c)].height_m);
    }
    EXPECT_GT(compared, 16);
  }
  EXPECT_EQ(borders, 1);
}

// At the pole all meridians meet, and across it the ground is continuous.
TEST_F(MapErrorOnWaves, ThePoleIsAPlaceLikeAnyOther) {
  MapError error;
  error.seed = 8;
  error.height = {{5, 400}};
  const MapErrorTerrain map = map_of(error);
  const double pole_m = map.height(-90, 0).height_m - truth().height(-90, 0).height_m;
  for (const double lon_deg : {-180.0, -90.0, 13.0, 120.0}) {
    EXPECT_NEAR(map.height(-90, lon_deg).height_m - truth().height(-90, lon_deg).height_m, pole_m, 1e-6);
    const auto added = [&](double lon) {
      return map.height(-89.9999, lon).height_m - truth().height(-89.9999, lon).height_m;
    };
    EXPECT_NEAR(added(lon_deg), pole_m, 0.3);
  }
  std::vector<double> differences;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> lat(-89.9, -89), lon(-180, 180);
  for (int i = 0; i < 1500; ++i) {
    const double lat_deg = lat(random), lon_deg = lon(random);
    differences.push_back(map.height(lat_deg, lon_deg).height_m - truth().height(lat_deg, lon_deg).height_m);
  }
  EXPECT_NEAR(moments_of(differences).deviation, 5, 0.4);
  EXPECT_NEAR(map.height(-89.2, 180).height_m, map.height(-89.2, -180).height_m, 1e-6);
}

}  // namespace
}  // namespace selenograph::dem
