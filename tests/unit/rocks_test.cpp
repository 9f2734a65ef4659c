// Rocks: against the law that they are drawn by, and in frames against rays in double past every triangle.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <set>
#include <tuple>

#include "dem/base/error.h"
#include "dem/detail/detail.h"
#include "dem/detail/detailed_terrain.h"
#include "dem/detail/footprints.h"
#include "dem/detail/rocks_on_ground.h"
#include "dem/terrain/surface_place.h"
#include "engine/camera/view.h"
#include "engine/renderer.h"
#include "engine/visibility/objects/object_mesh.h"
#include "engine/visibility/objects/objects_in_frame.h"
#include "engine/visibility/objects/rock_shapes.h"
#include "tests/support/float_tiles.h"
#include "tests/support/queries.h"
#include "tests/support/shared_data.h"

namespace selenograph {
namespace {

using test::open_terrain;
using test::TemporaryFolder;
using test::write_float_tile;

dem::Footprint square(double lat_deg, double lon_deg, double side_m) {
  const double half_deg = side_m / 2 / kMetresPerDegree, beside_deg = half_deg / std::cos(lat_deg * kRadiansPerDegree);
  return {lat_deg - half_deg, lat_deg + half_deg, lon_deg - beside_deg, lon_deg + beside_deg};
}

dem::RockLaw law_of(std::uint64_t seed, double on_ejecta) {
  dem::RockLaw law;
  law.seed = seed, law.frequency = dem::rocks_of_viper();
  law.smallest_m = 0.1, law.largest_m = 6, law.on_ejecta = on_ejecta;
  return law;
}

TEST(RockField, CountsAreThoseOfTheLaw) {
  double chi2 = 0;
  int degrees = 0;
  for (const std::uint64_t seed : {1, 2, 3, 4})
    for (const double on_ejecta : {1.0, 5.0}) {
      const dem::RockField field(law_of(seed, on_ejecta));
      for (int k = field.smallest_octave(); k <= field.largest_octave(); ++k)
        for (const double lat : {-88.0, 0.0, 61.0}) {
          const dem::Footprint box = square(lat, 20, std::ldexp(600.0, k));
          std::vector<dem::Rock> found;
          field.in_box(k, box, {}, found);
          const double low = std::max(0.1, std::ldexp(1.0, k)), high = std::min(6.0, std::ldexp(2.0, k));
          const auto above = [](double m) { return 0.0003 * std::pow(m, -2.482); };
          const double expected = dem::area_m2(box) * (above(low) - above(high));
          chi2 += std::pow(static_cast<double>(found.size()) - expected, 2) / expected;
          ++degrees;
          for (const dem::Rock& rock : found) {
            ASSERT_GE(rock.diameter_m, low);
            ASSERT_LE(rock.diameter_m, high);
            ASSERT_TRUE(dem::holds(box, to_geographic(rock.centre * kMoonRadius_m)));
          }
        }
    }
  ASSERT_GT(degrees, 100);
  EXPECT_NEAR(chi2, degrees, 5 * std::sqrt(2.0 * degrees));
}

TEST(RockField, TheSameRocksFromPiecesOfARegion) {
  dem::CraterLaw with_craters;
  with_craters.smallest_m = 16, with_craters.largest_m = 200;
  const dem::CraterField craters(with_craters);
  const dem::RockField field(law_of(7, 5));
  for (const dem::Footprint& box : {square(26, 3, 300), square(-75.5, 180, 300), square(89.99, 0, 300)}) {
    std::vector<dem::Rock> whole, pieces;
    const auto fresh_of = [&](const dem::Footprint& some, double radius_m) {
      const Geographic middle{(some.south_deg + some.north_deg) / 2, (some.west_deg + some.east_deg) / 2, 0};
      return field.fresh(craters, 100, to_cartesian(middle).normalized(), radius_m);
    };
    field.in_box(-1, box, fresh_of(box, 250), whole);
    for (const dem::Footprint& piece : dem::cut(box, 37)) field.in_box(-1, piece, fresh_of(piece, 40), pieces);
    const auto ids = [](const std::vector<dem::Rock>& rocks) {
      std::set<std::uint64_t> all;
      for (const dem::Rock& rock : rocks) all.insert(rock.id);
      return all;
    };
    ASSERT_GT(whole.size(), 50U);
    EXPECT_EQ(ids(whole), ids(pieces));
  }
}

// Around a crater of known age, ring by ring: 1 + (on_ejecta - 1) enriched() times as many as elsewhere.
TEST(RockField, FreshCratersHaveMore) {
  dem::CraterLaw with_craters;
  with_craters.smallest_m = 64, with_craters.largest_m = 128;
  const dem::CraterField craters(with_craters);
  dem::RockLaw law = law_of(3, 9);
  law.frequency = {{{0.02, 2.4}}};
  const dem::RockField field(law);
  EXPECT_EQ(field.enriched(0, 0.5), 1);
  EXPECT_NEAR(field.enriched(0, 2), 1.0 / 8, 1e-12);
  EXPECT_NEAR(field.enriched(60, 1), 0.5, 1e-12);
  EXPECT_EQ(field.enriched(0, 9), 0);
  const dem::Footprint region = square(10, 20, 900);
  std::vector<dem::Crater> all, fresh;
  craters.near(6, to_cartesian({10, 20, 0}).normalized(), 900, all);
  for (const dem::Crater& c : all)
    if (field.enriched(c.age_Ma, 1) >= 0.01) fresh.push_back(c);
  std::vector<dem::Rock> rocks;
  field.in_box(-1, region, field.fresh(craters, 100, to_cartesian({10, 20, 0}).normalized(), 900), rocks);
  // What the law expects of each rock's place: thinned so, they are uniform.
  double expected_fresh = 0, found_fresh = 0;
  const double per_m2 = law.frequency.above(0.5) - law.frequency.above(1);
  constexpr int kPlaces = 150;
  const auto enriched_at = [&](const Vec3& place) {
    double most = 0;
    for (const dem::Crater& c : fresh)
      most = std::max(most, field.enriched(c.age_Ma, (place - c.centre).norm() * kMoonRadius_m / c.diameter_m * 2));
    return most;
  };
  double fresh_area = 0, area = 0;
  for (int r = 0; r < kPlaces; ++r)
    for (int c = 0; c < kPlaces; ++c) {
      const double lat = std::lerp(region.south_deg, region.north_deg, (r + 0.5) / kPlaces),
                   lon = std::lerp(region.west_deg, region.east_deg, (c + 0.5) / kPlaces);
      const double enriched = enriched_at(to_cartesian({lat, lon, 0}).normalized());
      const double cell_m2 = dem::area_m2(region) / kPlaces / kPlaces;
      area += cell_m2;
      if (enriched > 0.2) fresh_area += cell_m2, expected_fresh += cell_m2 * per_m2 * (1 + 8 * enriched);
    }
  for (const dem::Rock& rock : rocks) found_fresh += enriched_at(rock.centre) > 0.2;
  ASSERT_GT(fresh_area, area / 1000);
  ASSERT_GT(expected_fresh, 200);
  ASSERT_GT(expected_fresh, 2 * fresh_area * per_m2);
  EXPECT_NEAR(found_fresh, expected_fresh, 4 * std::sqrt(expected_fresh) + 0.02 * expected_fresh);
}

// Blocks are narrow in metres where they are wide in degrees. What surrounds one is all that its rocks depend on.
TEST(RockSurvey, SearchesAsMuchGroundAtAPoleAsAtTheEquator) {
  const TemporaryFolder folder;
  test::write_global_tile(folder.path(), 4, [](double, double) { return 0; });
  dem::DetailPreset preset;
  preset.craters.smallest_m = 16, preset.craters.largest_m = 500;
  preset.rocks = law_of(5, 5);
  const dem::DetailedTerrain terrain(open_terrain(folder.path()), std::make_shared<const dem::Detail>(preset));
  const dem::RockSurvey survey(terrain);
  const dem::RockField& field = survey.field();
  std::size_t at_equator = 0;
  for (const auto& [lat, lon] : {std::pair{0.01, 20.0},
                                 {45.01, 20.0},
                                 {89.9, 20.0},
                                 {89.99, 20.0},
                                 {90.0, 20.0},
                                 {90.0, -180.0},
                                 {-89.9, 100.0},
                                 {-90.0, 100.0}}) {
    const dem::BlockId id = survey.block_around(lat, lon);
    const auto found = survey.fresh_around(id, {});
    if (lat == 0.01) at_equator = found->size();
    ASSERT_GT(at_equator, 100U);
    EXPECT_LT(found->size(), 5 * at_equator / 4) << lat;
    EXPECT_GT(found->size(), at_equator / 4) << lat;
    // Whatever is farther away changes nothing.
    const dem::Circle block = dem::circle_around(dem::footprint_of(id));
    const std::vector<dem::FreshCrater> wide = field.fresh(terrain.detail().craters(), 100, block.middle, 4000);
    ASSERT_GT(wide.size(), found->size());
    const dem::Footprint box = dem::footprint_of(id);
    for (int i = 0; i < 25; ++i) {
      const Vec3 place = to_cartesian({std::lerp(box.south_deg, box.north_deg, i / 5 / 4.0),
                                       std::lerp(box.west_deg, box.east_deg, i % 5 / 4.0), 0})
                             .normalized();
      const auto enriched = [&](const std::vector<dem::FreshCrater>& craters) {
        double most = 0;
        for (const dem::FreshCrater& c : craters)
          most = std::max(most, field.enriched(c.age_Ma, (place - c.centre).norm() * kMoonRadius_m / c.radius_m));
        return most;
      };
      EXPECT_EQ(enriched(*found), enriched(wide)) << lat;
    }
  }
}

// Rocks cover 0.4 % of the Moon (Bandfield et al. 2011), of the rockiest ejecta 0.27 (age / Ma)^-0.46 (Ghent et al.
// 2014): the default law has so many times as many there.
TEST(RockField, EjectaAreAsRockyAsPublished) {
  const dem::RockField field(dem::RockLaw{.frequency = dem::rocks_of_viper(), .largest_m = 8, .smallest_m = 0.05});
  for (const double age_Ma : {5.0, 10.0, 20.0, 50.0, 100.0, 150.0}) {
    const double published = 0.27 * std::pow(age_Ma, -0.46) / 0.004,
                 here = 1 + (field.law().on_ejecta - 1) * field.enriched(age_Ma, 1);
    EXPECT_GT(here, published / 1.4) << age_Ma;
    EXPECT_LT(here, published * 1.4) << age_Ma;
  }
}

dem::Rock rock_of(const dem::RockField& field, double age_Ma, std::uint64_t number) {
  dem::Rock rock{Vec3::unit_x(), 2.5, age_Ma, number, dem::Draws(1, 0, static_cast<int>(number), 0).bits()};
  field.settle(rock);
  return rock;
}

TEST(RockField, OldRocksAreBuriedDeeperAndHaveHigherFillets) {
  const dem::RockField field(law_of(1, 5));
  constexpr int kRocks = 400;
  struct Mean {
    double buried = 0, height = 0, fillet = 0, least = 1, most = 0;
  };
  const auto mean_at = [&](double age_Ma) {
    Mean mean;
    for (int i = 0; i < kRocks; ++i) {
      const dem::Rock rock = rock_of(field, age_Ma, static_cast<std::uint64_t>(i));
      const double whole = rock.height_m / (1 - rock.buried) / rock.diameter_m;
      EXPECT_GE(whole, 0.6);
      EXPECT_LE(whole, 1);
      EXPECT_LE(rock.fillet_m, 0.1 * rock.diameter_m);
      EXPECT_LE(rock.fillet_m, 0.3 * rock.height_m);
      mean.buried += rock.buried / kRocks, mean.height += rock.height_m / rock.diameter_m / kRocks;
      mean.fillet += rock.fillet_m / rock.height_m / kRocks;
      mean.least = std::min(mean.least, rock.buried), mean.most = std::max(mean.most, rock.buried);
    }
    return mean;
  };
  const Mean fresh = mean_at(0), middle = mean_at(60), old = mean_at(600);
  EXPECT_NEAR(fresh.buried, 0.2, 0.02);
  EXPECT_NEAR(old.buried, 0.425, 0.02);
  EXPECT_NEAR(fresh.height, 0.64, 0.02);
  EXPECT_NEAR(middle.height, 0.55, 0.02);
  EXPECT_EQ(fresh.fillet, 0);
  EXPECT_GT(middle.fillet, 0.1);
  EXPECT_GT(old.fillet, 1.2 * middle.fillet);
  // Each rock by itself.
  EXPECT_LT(old.least, 0.2);
  EXPECT_GT(old.most, 0.65);
}

// Of a block, kept, as of a box, and as without anything kept; nothing is looked for twice.
TEST(RockSurvey, FindsTheSameAgainWithoutLooking) {
  const TemporaryFolder folder;
  test::write_global_tile(folder.path(), 4, [](double, double) { return 0; });
  dem::DetailPreset preset;
  preset.craters.smallest_m = 16, preset.craters.largest_m = 500;
  preset.rocks = law_of(5, 25);
  const auto plain = open_terrain(folder.path());
  const auto detail = std::make_shared<const dem::Detail>(preset);
  const dem::DetailedTerrain terrain(plain, detail);
  const auto memory = std::make_shared<dem::RockMemory>(std::size_t{4} << 20);
  const auto found = [&](const dem::RockSurvey& survey, int octave, double smallest_m) {
    std::vector<dem::RockFeature> rocks;
    survey.add(octave, dem::block_at_place(14 - octave, 10.003, 20.004), smallest_m, rocks, {});
    return dem::largest_first(std::move(rocks));
  };
  const auto same = [](const std::vector<dem::RockFeature>& a, const std::vector<dem::RockFeature>& b) {
    return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), [](const auto& x, const auto& y) {
             return x.rock.id == y.rock.id && x.position_m == y.position_m && x.up == y.up;
           });
  };
  std::size_t all = 0;
  for (const int octave : {-3, -2, 0})
    for (const double smallest_m : {0.0, 1.05, 1.1, 1.3, 1.9}) {
      const auto first = found(dem::RockSurvey(terrain, memory), octave, std::ldexp(smallest_m, octave));
      const std::uint64_t misses = memory->misses();
      EXPECT_TRUE(same(first, found(dem::RockSurvey(terrain, memory), octave, std::ldexp(smallest_m, octave))));
      EXPECT_EQ(memory->misses(), misses);
      EXPECT_TRUE(same(first, found(dem::RockSurvey(terrain), octave, std::ldexp(smallest_m, octave))));
      for (const dem::RockFeature& rock : first) EXPECT_GE(rock.rock.diameter_m, std::ldexp(smallest_m, octave));
      all += first.size();
      // A little nearer, it is known already: diameters are a quarter of an octave apart.
      if (smallest_m == 1.1) {
        found(dem::RockSurvey(terrain, memory), octave, std::ldexp(1.15, octave));
        EXPECT_EQ(memory->misses(), misses);
      }
    }
  EXPECT_GT(all, 50U);
  EXPECT_LE(memory->bytes(), std::size_t{4} << 20);
  // Another terrain has rocks of its own.
  preset.rocks.seed = 6;
  const dem::DetailedTerrain other(plain, std::make_shared<const dem::Detail>(preset));
  EXPECT_FALSE(same(found(dem::RockSurvey(terrain, memory), -2, 0), found(dem::RockSurvey(other, memory), -2, 0)));
}

TEST(RockShapes, AreClosed) {
  for (const auto& mesh : engine::rock_shapes()) {
    const engine::ObjectShape& shape = mesh->shape();
    using Place = std::tuple<float, float, float>;  // triangles have corners of their own
    std::set<std::pair<Place, Place>> edges;
    const auto place = [&](std::uint32_t corner) {
      const Vec3f& p = shape.corners[corner].place;
      return Place(p.x(), p.y(), p.z());
    };
    double volume = 0;
    for (const engine::ObjectTriangle& t : shape.triangles) {
      for (std::size_t i = 0; i < 3; ++i)
        ASSERT_TRUE(edges.emplace(place(t.corner[i]), place(t.corner[(i + 1) % 3])).second);
      volume += shape.place(t, 0).dot(shape.place(t, 1).cross(shape.place(t, 2))) / 6;
      const Vec3 facet = (shape.place(t, 1) - shape.place(t, 0)).cross(shape.place(t, 2) - shape.place(t, 0));
      for (const std::uint32_t corner : t.corner)
        EXPECT_GT(shape.corners[corner].normal.cast<double>().dot(facet.normalized()), 0.8);
    }
    for (const auto& [a, b] : edges) ASSERT_TRUE(edges.contains({b, a}));
    EXPECT_GT(volume, 0.3);
  }
}

std::vector<Vec3> places_of(const engine::PlacedShape& shape) {
  std::set<std::tuple<float, float, float>> once;
  for (const engine::ObjectCorner& corner : shape.mesh->shape().corners)
    once.emplace(corner.place.x(), corner.place.y(), corner.place.z());
  std::vector<Vec3> places;
  for (const auto& [x, y, z] : once) places.push_back(shape.from_mesh * Vec3f(x, y, z).cast<double>());
  return places;
}

TEST(RockShapes, LieAsTheListHasThem) {
  const dem::RockField field(law_of(1, 5));
  std::set<const engine::ObjectMesh*> meshes;
  for (std::uint64_t i = 0; i < 150; ++i) {
    const dem::Rock rock = rock_of(field, static_cast<double>(i), i);
    const Vec3 up = Vec3(0.9, 0.1, 0.3).normalized(), east = up.unit_orthogonal(), north = up.cross(east);
    const engine::PlacedShape shape = engine::placed_rock(rock, up);
    meshes.insert(shape.mesh);
    double wide2 = 0, high = -1e9, low = 1e9, far = 0;
    const std::vector<Vec3> places = places_of(shape);
    for (const Vec3& a : places) {
      high = std::max(high, a.dot(up)), low = std::min(low, a.dot(up)), far = std::max(far, a.norm());
      for (const Vec3& b : places)
        wide2 = std::max(wide2, std::pow((a - b).dot(east), 2) + std::pow((a - b).dot(north), 2));
    }
    EXPECT_NEAR(std::sqrt(wide2), rock.diameter_m, 1e-3 * rock.diameter_m);
    EXPECT_NEAR(high, rock.height_m, 1e-5);
    EXPECT_NEAR(low, rock.height_m - rock.height_m / (1 - rock.buried), 1e-5);
    EXPECT_LT(far, rock.diameter_m);
    const auto soil = engine::placed_fillet(rock, up);
    ASSERT_EQ(soil.has_value(), rock.fillet_m > 0.02 * rock.diameter_m);
    if (!soil) continue;
    for (const Vec3& a : places_of(*soil)) EXPECT_LT(a.norm(), rock.diameter_m);
  }
  EXPECT_GT(meshes.size(), 15U);
}

// It is as high as its rock's side has it, on some sides next to nothing, slopes as loose soil does, and goes on below
// the ground.
TEST(RockShapes, SoilIsNoBrim) {
  for (const auto& mesh : engine::fillet_shapes()) {
    const engine::ObjectShape& shape = mesh->shape();
    double lowest = 1e9, highest = -1e9, steepness = 0;
    int on_slope = 0;
    for (const engine::ObjectCorner& corner : shape.corners) {
      const Vec3 p = corner.place.cast<double>(), n = corner.normal.cast<double>();
      EXPECT_NEAR(n.norm(), 1, 1e-5);
      EXPECT_GT(n.z(), 0);
      EXPECT_LT(p.z(), 1.7);
      const double radius = p.xy().norm();
      if (radius > 0.66 && radius < 0.72) lowest = std::min(lowest, p.z()), highest = std::max(highest, p.z());
      if (radius > 1.1) {
        EXPECT_LT(p.z(), -0.2);
      }
      // As high as soil is heaped, a tenth of the diameter, at 0.7 diameters.
      if (radius > 0.72 && p.z() > 0) ++on_slope, steepness += std::hypot(n.x(), n.y()) / n.z() * 0.1 / 0.7;
    }
    EXPECT_LT(lowest, 0.4);
    EXPECT_GT(highest, 0.9);
    EXPECT_GT(steepness / on_slope, std::tan(15 * kRadiansPerDegree));
    EXPECT_LT(steepness / on_slope, std::tan(35 * kRadiansPerDegree));
    for (const engine::ObjectTriangle& t : shape.triangles)
      EXPECT_GT((shape.place(t, 1) - shape.place(t, 0)).cross(shape.place(t, 2) - shape.place(t, 0)).z(), 0);
  }
}

// --- in frames

class RocksInFrames : public testing::Test {
 protected:
  static constexpr double kLat = 10.25, kLon = 20.25;

  RocksInFrames() {
    write_float_tile(folder_.path(), "hill", {10.5, 20, 128, 65, 65},
                     [](double lat, double lon) { return 100 + 30 * std::sin(900 * lat) + 20 * std::cos(1100 * lon); });
    terrain_ = open_terrain(folder_.path());
    dem::DetailPreset preset;
    preset.craters.smallest_m = 2, preset.craters.largest_m = 100;
    preset.rocks = law_of(5, 5);
    preset.rocks.frequency = dem::rocks_of_haworth();
    detail_ = std::make_shared<const dem::Detail>(preset);
    renderer_ = std::make_unique<engine::Renderer>(terrain_, engine::RendererOptions{1, std::size_t{256} << 20});
  }

  engine::FrameRequest request(double height_m, int side) const {
    engine::FrameRequest request;
    request.camera.width = request.camera.height = side;
    request.camera.fx = request.camera.fy = side, request.camera.cx = request.camera.cy = (side - 1) / 2.0;
    const double ground_m = renderer_->terrain_with(detail_)->height(kLat, kLon).height_m;
    request.pose.position_m = to_cartesian({kLat, kLon, ground_m + height_m});
    const EastNorthUp axes = local_axes(request.pose.position_m);
    Mat3 camera;  // nadir, north up, tilted a little
    camera.col(0) = axes.east, camera.col(1) = -axes.north, camera.col(2) = -axes.up;
    request.pose.camera_from_moon = (Quat(camera) * AngleAxis(0.3, Vec3::unit_x())).conjugate();
    request.sun.direction = (std::sin(0.4) * axes.up + std::cos(0.4) * axes.east).normalized();
    request.detail = detail_;
    request.products = engine::kDetail | engine::kPosition | engine::kLit | engine::kObjectId | engine::kRange;
    return request;
  }

  TemporaryFolder folder_;
  std::shared_ptr<dem::PyramidTerrain> terrain_;
  std::shared_ptr<const dem::Detail> detail_;
  std::unique_ptr<engine::Renderer> renderer_;
};

struct Placed {
  Vec3 position;
  Mat3 turned;  // and stretched
  const engine::ObjectMesh* mesh;
  double radius_m;
  bool soil;

  // The nearest triangle from `from` on, in double; its distance.
  double meet(const Vec3& from, const Vec3& direction, double nearest) const {
    const Vec3 to = position - from;
    const double along = to.dot(direction);
    if ((to - along * direction).norm() > radius_m || along < -radius_m || along - radius_m > nearest) return nearest;
    const engine::ObjectShape& shape = mesh->shape();
    for (const engine::ObjectTriangle& t : shape.triangles) {
      const Vec3 a = position + turned * shape.place(t, 0), ab = position + turned * shape.place(t, 1) - a,
                 ac = position + turned * shape.place(t, 2) - a;
      const Vec3 p = direction.cross(ac), s = from - a, q = s.cross(ab);
      const double det = ab.dot(p), u = s.dot(p) / det, v = direction.dot(q) / det, d = ac.dot(q) / det;
      if (u >= 0 && v >= 0 && u + v <= 1 && d > 1e-4 * radius_m && d < nearest) nearest = d;
    }
    return nearest;
  }
};

// Rocks that a frame shows, from a list of all that are around, and the soil against them.
std::vector<Placed> placed_rocks(const engine::FrameRequest& asked, const std::vector<dem::RockFeature>& all) {
  const engine::View view(asked.camera, asked.pose);
  std::vector<Placed> rocks;
  for (const dem::RockFeature& rock : all) {
    if (rock.rock.diameter_m * view.pixels_per_metre(rock.position_m, 0) < 1) continue;
    const auto add = [&](const engine::PlacedShape& shape, bool soil) {
      rocks.push_back({rock.position_m + shape.from_mesh.translation, shape.from_mesh.linear, shape.mesh,
                       2 * rock.rock.diameter_m, soil});
    };
    add(engine::placed_rock(rock.rock, rock.up), false);
    const double soil_px = rock.rock.fillet_m * view.pixels_per_metre(rock.position_m, 0);
    const auto soil = engine::placed_fillet(rock.rock, rock.up);
    if (soil && soil_px >= asked.accuracy.max_error_px / 2) add(*soil, true);
  }
  return rocks;
}

TEST_F(RocksInFrames, AreWhereTheListHasThem) {
  engine::FrameRequest asked = request(40, 192);
  asked.accuracy.max_error_px = 0.5;
  const auto detailed = renderer_->terrain_with(detail_);
  const std::vector<Placed> rocks =
      placed_rocks(asked, dem::RockSurvey(*detailed).rocks_in(square(kLat, kLon, 260), 0.1, {}));
  ASSERT_GT(rocks.size(), 300U);
  for (const engine::Visibility visibility : {engine::Visibility::zbuffer, engine::Visibility::raytrace}) {
    asked.visibility = visibility;
    const engine::Frame frame = renderer_->render(asked);
    EXPECT_EQ(frame.report.visibility, visibility);
    EXPECT_EQ(frame.report.least_rock_px, 1);
    EXPECT_GT(frame.report.rocks, 100U);
    engine::FrameRequest without = asked;
    dem::DetailPreset preset = detail_->preset();
    preset.rocks = {}, preset.fingerprint = 1;
    without.detail = std::make_shared<const dem::Detail>(preset);
    const engine::Frame ground = renderer_->render(without);
    EXPECT_EQ(ground.report.rocks, 0U);
    std::size_t on_rocks = 0, on_soil = 0, wrong = 0, shaded = 0, wrong_light = 0, asked_light = 0;
    const Vec3 eye = asked.pose.position_m;
    for (std::size_t i = 0; i < frame.products.detail.size(); ++i) {
      const auto at = [&](const engine::Frame& f) {
        return Vec3(f.products.position[3 * i], f.products.position[3 * i + 1], f.products.position[3 * i + 2]);
      };
      const bool rock = frame.products.detail[i] == 3;
      on_rocks += rock;
      EXPECT_EQ(frame.products.object_id[i], engine::kNoObject);
      const Vec3 there = at(ground), direction = (there - eye).normalized();
      double nearest = (there - eye).norm();
      const Placed* met = nullptr;
      for (const Placed& one : rocks)
        if (const double d = one.meet(eye, direction, nearest); d < nearest) nearest = d, met = &one;
      if ((met && !met->soil) != rock || std::abs(nearest - frame.products.range[i]) > 1e-4) ++wrong;
      const bool soil = met && met->soil;
      on_soil += soil;
      if (soil && !rock) {
        EXPECT_EQ(frame.products.detail[i], 2);
      }
      // Shadows: of the ground that is lit without rocks.
      if (rock || soil || ground.products.lit[i] == 0 || i % 3 != 0) continue;
      ++asked_light;
      const double free = std::numeric_limits<double>::infinity();
      double blocked = free;
      for (const Placed& one : rocks) blocked = std::min(blocked, one.meet(there, asked.sun.direction, blocked));
      shaded += frame.products.lit[i] == 0;
      wrong_light += (frame.products.lit[i] == 0) != (blocked < free);
    }
    fmt::print(
        "{} rocks in view of {}: {} pixels see one, {} soil against it, {} of {} lie in a shadow; wrong: {}, {}\n",
        frame.report.rocks, rocks.size(), on_rocks, on_soil, shaded, asked_light, wrong, wrong_light);
    EXPECT_GT(on_rocks, 300U);
    EXPECT_GT(on_soil, 100U);
    EXPECT_GT(shaded, 50U);
    EXPECT_NEAR(frame.report.rock_fraction, static_cast<double>(on_rocks) / 192 / 192, 1e-12);
    // Float chooses the triangle: a line of sight along an outline may miss what it touches.
    EXPECT_LE(wrong, 2U);
    EXPECT_LE(wrong_light, 2U);
  }
}

// What was kept of other frames changes nothing.
TEST_F(RocksInFrames, AreTheSameWhateverWasSeenBefore) {
  const auto frame_after = [&](const std::vector<double>& heights_m) {
    const engine::Renderer renderer(terrain_, engine::RendererOptions{1, std::size_t{256} << 20});
    for (const double height_m : heights_m) renderer.render(request(height_m, 64));
    return renderer.render(request(40, 128));
  };
  const engine::Frame alone = frame_after({});
  EXPECT_GT(alone.report.rocks, 50U);
  for (const std::vector<double>& before : {std::vector<double>{40}, {60, 41}, {20, 39}}) {
    const engine::Frame frame = frame_after(before);
    EXPECT_EQ(frame.report.rocks, alone.report.rocks);
    EXPECT_EQ(frame.products.position.size(), alone.products.position.size());
    EXPECT_EQ(0, std::memcmp(frame.products.position.data(), alone.products.position.data(),
                             alone.products.position.size() * sizeof(double)));
    EXPECT_EQ(frame.products.detail, alone.products.detail);
    EXPECT_EQ(0, std::memcmp(frame.products.lit.data(), alone.products.lit.data(),
                             alone.products.lit.size() * sizeof(float)));
  }
}

// A ray is followed in steps: what it meets is the same wherever on its way the steps begin. All of the ground below
// its whole way is more than scenes may hold here.
TEST_F(RocksInFrames, RaysAreFollowedNoFartherThanTheyGo) {
  const engine::Renderer small(terrain_, {1, std::size_t{48} << 20});
  const double ground_m = small.terrain_with(detail_)->height(kLat, kLon).height_m;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> down(-2, 70), around(0, 360), height(0.3, 400), share(0.05, 0.95);
  int asked = 0, near = 0, far = 0, other = 0;
  while (asked < 150) {
    const Vec3 from = to_cartesian({kLat, kLon, ground_m + (asked % 2 ? 1 : height(random))});
    const EastNorthUp axes = local_axes(from);
    const double below = down(random) * kRadiansPerDegree, azimuth = around(random) * kRadiansPerDegree;
    const Vec3 ahead = std::sin(azimuth) * axes.east + std::cos(azimuth) * axes.north;
    const engine::Ray ray{from, (std::cos(below) * ahead - std::sin(below) * axes.up).normalized()};
    const engine::RayHit hit = test::cast_rays(*renderer_, {&ray, 1}, {}, {}, detail_).front();
    if (!hit.hit || hit.range_m > 1500) continue;
    ++asked, near += hit.range_m<16, far += hit.range_m> 64;
    for (const double part : {0.0, share(random), 0.99}) {
      const engine::Ray later{ray.origin_m + part * hit.range_m * ray.direction, ray.direction};
      const engine::RayHit again = test::cast_rays(small, {&later, 1}, {}, {}, detail_).front();
      other += !again.hit || again.rock != hit.rock || (again.position_m - hit.position_m).norm() > 1e-6;
    }
  }
  fmt::print("{} rays, {} shorter than 16 m, {} longer than 64 m; otherwise: {}\n", asked, near, far, other);
  EXPECT_GT(near, 20);
  EXPECT_GT(far, 20);
  EXPECT_LE(other, 2);  // float chooses the triangle, as above
}

engine::LidarRequest flash_over(const engine::FrameRequest& ground, int side, double fov_deg) {
  engine::LidarRequest request;
  request.scenery.detail = ground.detail;
  request.pose = ground.pose;
  request.instrument.divergence_mrad = 1;
  request.instrument.receiver = {.signal = engine::LidarSignal::snr, .snr = 100, .range_m = 1000};
  request.instrument.gate = {1, 1e5};
  request.pattern = {.scan = engine::LidarScan::flash, .columns = side, .rows = side, .fov_x_deg = fov_deg};
  return request;
}

// Which beams share a scene depends on the memory for scenes; no bit of what they measure does.
TEST_F(RocksInFrames, ALidarMeasuresTheSameWithLessMemory) {
  const engine::Renderer small(terrain_, {1, std::size_t{16} << 20});
  const engine::LidarRequest request = flash_over(this->request(60, 64), 96, 30);
  const engine::LidarReturns a = test::scan_lidar(*renderer_, request), b = test::scan_lidar(small, request);
  EXPECT_GT(std::count_if(a.rock.begin(), a.rock.end(), [](std::uint64_t rock) { return rock != 0; }), 20);
  for (const auto column :
       {&engine::LidarReturns::range_m, &engine::LidarReturns::true_range_m, &engine::LidarReturns::axis_range_m})
    EXPECT_EQ(std::memcmp((a.*column).data(), (b.*column).data(), a.size() * sizeof(double)), 0);
  EXPECT_EQ(a.rock, b.rock);
}

// A beam needs ground as fine as what it lights up: 256 beams of 4 m, 66 m apart, need a few blocks each.
TEST_F(RocksInFrames, BeamsThatAreFarApartMakeTheGroundBelowThemAlone) {
  const std::uint64_t before = terrain_->statistics().misses;
  const engine::LidarReturns scan = test::scan_lidar(*renderer_, flash_over(request(4000, 64), 16, 15));
  for (const double range_m : scan.true_range_m) EXPECT_NEAR(range_m, 4200, 300);
  EXPECT_LT(terrain_->statistics().misses - before, 256U * 24);
}

// Between what a beam sees of coarser ground and the finest ground is less than the beam averages over.
TEST_F(RocksInFrames, GroundForABeamIsTheFinestWithinItsFootprint) {
  engine::LidarRequest request = flash_over(this->request(1000, 64), 8, 4);
  request.instrument.sub_rays = 61;
  const engine::LidarReturns beams = test::scan_lidar(*renderer_, request);
  std::vector<engine::Ray> rays;
  const auto at3 = [](const std::vector<double>& v, std::size_t i) {
    return Vec3(v[3 * i], v[3 * i + 1], v[3 * i + 2]);
  };
  for (std::size_t i = 0; i < beams.size(); ++i) rays.push_back({at3(beams.origin_m, i), at3(beams.direction, i)});
  const std::vector<engine::RayHit> finest = test::cast_rays(*renderer_, rays, {}, {}, detail_);
  double square = 0;
  for (std::size_t i = 0; i < beams.size(); ++i) square += std::pow(beams.axis_range_m[i] - finest[i].range_m, 2);
  const double rms_m = std::sqrt(square / static_cast<double>(beams.size()));
  fmt::print("axes of 1 m wide beams: {:.4f} m RMS from the finest ground\n", rms_m);
  EXPECT_LT(rms_m, 0.05);
}

TEST_F(RocksInFrames, InsideARockThereIsNoCameraAndNoLidar) {
  const auto ground = renderer_->terrain_with(detail_);
  const std::vector<dem::RockFeature> rocks = dem::RockSurvey(*ground).rocks_in(square(kLat, kLon, 200), 1, {});
  ASSERT_GT(rocks.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const dem::RockFeature& rock = rocks[i];
    for (const double height : {0.5, 1.5}) {
      engine::FrameRequest frame = request(10, 8);
      frame.pose.position_m = rock.position_m + height * rock.rock.height_m * rock.position_m.normalized();
      engine::LidarRequest scan = flash_over(frame, 2, 1);
      if (height > 1) {
        EXPECT_NO_THROW(renderer_->render(frame));
        EXPECT_NO_THROW(test::scan_lidar(*renderer_, scan));
        continue;
      }
      EXPECT_THROW(renderer_->render(frame), ImpossibleRequest) << rock.rock.diameter_m;
      EXPECT_THROW(test::scan_lidar(*renderer_, scan), ImpossibleRequest);
      EXPECT_THROW(test::project_landmarks(*renderer_, frame, {}), ImpossibleRequest);
    }
  }
}

}  // namespace
}  // namespace selenograph
