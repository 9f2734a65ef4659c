// Least-squares normals: exact for planes in latitude and longitude, smooth on quantised slopes, vertical where nothing
// is known.
#include "dem/grid/shading_normals.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

namespace selenograph::dem {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

constexpr HeightsKind kMetres{.quantisation_m = 1}, kFiltered{.filtered = true};

struct Field {
  Block block;
  std::vector<float> heights;
};

// `height` takes rows and columns from the block's south-west post.
Field field(int level, double lat, double lon, const std::function<double(int, int)>& height,
            const HeightsKind& kind = {}) {
  Field f;
  f.block.id = block_at(level, static_cast<Tick>((lat + 90) * kTicksPerDegree),
                        static_cast<Tick>((lon + 180) * kTicksPerDegree));
  f.block.extent = extent_of(f.block.id);
  fill_trigonometry(f.block);
  const int side = f.block.side();
  for (int r = -kHalo; r < side + kHalo; ++r)
    for (int c = -kHalo; c < side + kHalo; ++c) {
      const float h = static_cast<float>(height(r, c));
      f.heights.push_back(h);
      if (r >= 0 && c >= 0 && r < side && c < side) f.block.vertices.push_back({h, Vec3f::zero()});
    }
  fill_shading_normals(f.block, f.heights, kind);
  return f;
}

Vec3 up(const Block& b, int r, int c) { return b.position(r, c, 0).normalized(); }
double angle_deg(const Vec3& a, const Vec3& b) { return std::atan2(a.cross(b).norm(), a.dot(b)) / kDegree; }

TEST(ShadingNormals, ASphereIsShadedByItsVertical) {
  for (const double height : {0.0, -9000.0, 10000.0}) {
    const Field f = field(8, 33, -120, [&](int, int) { return height; });
    for (int r = 0; r <= 64; ++r)
      for (int c = 0; c <= 64; ++c)
        ASSERT_LT((f.block.vertices[f.block.index(r, c)].normal.cast<double>() - up(f.block, r, c)).norm(), 1.3e-7);
  }
}

TEST(ShadingNormals, SlopesInClosedForm) {
  // Rising a m per post northward and b m per post eastward: slopes a / (R dlat), b / (R cos(lat) dlon) at height 0.
  for (const double lat : {0.5, 50.0, -72.0}) {
    const double a = 3, b = -2;
    const Field f = field(12, lat, 20, [&](int r, int c) { return a * (r - 10) + b * (c - 10); });
    const Vec3 normal = f.block.vertices[f.block.index(10, 10)].normal.cast<double>();
    const double at = lat_deg_of(f.block.extent.lat0 + 10 * f.block.extent.lat_step);
    const EastNorthUp axes = local_axes(up(f.block, 10, 10));
    const double step = kDegree / 4096 * kMoonRadius_m;
    EXPECT_NEAR(normal.dot(axes.north) / normal.dot(axes.up), -a / step, 1e-6);
    EXPECT_NEAR(normal.dot(axes.east) / normal.dot(axes.up),
                -b / (step * std::cos(at * kDegree) * (f.block.extent.lon_step / f.block.extent.lat_step)), 1e-6);
    EXPECT_NEAR(normal.norm(), 1, 1e-6);
  }
}

TEST(ShadingNormals, QuantisedSlopesShowNoTerraces) {
  // A slope of 0.04 m per post (a third of a degree) in whole metres: 1 m steps every 25 posts. Raw differences would
  // be off by 7.4 degrees.
  const auto ramp = [](int r, int) { return 0.04 * r; };
  const Field exact = field(12, 10, 20, ramp),
              rounded = field(
                  12, 10, 20, [&](int r, int c) { return std::round(ramp(r, c)); }, kMetres);
  double worst = 0;
  for (int r = 5; r < 60; ++r)
    worst = std::max(worst, angle_deg(exact.block.vertices[exact.block.index(r, 30)].normal.cast<double>(),
                                      rounded.block.vertices[rounded.block.index(r, 30)].normal.cast<double>()));
  EXPECT_LT(worst, 2.1);  // the 5 x 5 plane's answer to a step: atan(6 * 5 / 50 ... ) in the worst phase
  EXPECT_GT(worst, 0.1) << "nothing was quantised: the test tests nothing";
}

TEST(ShadingNormals, TheWiderStencilIsForCoarseStepsOnly) {
  // A single raised post: the 3 x 3 stencil reaches one post far, the 5 x 5 two.
  const auto spike = [](int r, int c) { return r == 30 && c == 30 ? 10.0 : 0.0; };
  const auto moved = [](const Field& f, int c) {
    return (f.block.vertices[f.block.index(30, c)].normal.cast<double>() - up(f.block, 30, c)).norm() > 1e-4;
  };
  const Field floats = field(12, 10, 20, spike), metres = field(12, 10, 20, spike, kMetres),
              coarse = field(8, 10, 20, spike, kMetres);
  EXPECT_TRUE(moved(floats, 31) && moved(metres, 31) && moved(metres, 32) && moved(coarse, 31));
  EXPECT_FALSE(moved(floats, 32) || moved(coarse, 32) || moved(metres, 33));
}

TEST(ShadingNormals, VoidsAreLeftOut) {
  // A plane stays exact beside voids as long as three posts span it; a lone post has its vertical.
  const auto plane = [](int r, int c) { return 2.0 * r - 3.0 * c; };
  const Field whole = field(12, 10, 20, plane);
  const Field holes =
      field(12, 10, 20, [&](int r, int c) { return (r + 2 * c) % 5 == 0 && r > 3 ? std::nan("") : plane(r, c); });
  for (int r = 0; r <= 64; ++r)
    for (int c = 0; c <= 64; ++c) {
      const std::size_t at = whole.block.index(r, c);
      if (!std::isnan(holes.block.vertices[at].height_m)) {
        ASSERT_LT((whole.block.vertices[at].normal - holes.block.vertices[at].normal).norm(), 1e-5F) << r << ' ' << c;
      }
    }
  const Field lone = field(12, 10, 20, [&](int r, int c) { return r == 9 && c == 9 ? 100.0 : std::nan(""); });
  EXPECT_LT((lone.block.vertices[lone.block.index(9, 9)].normal.cast<double>() - up(lone.block, 9, 9)).norm(), 1e-6);
  for (const auto& v : lone.block.vertices) ASSERT_TRUE(v.normal.is_finite());
}

TEST(ShadingNormals, LowPassOfFilteredLevelsIsUndone) {
  // A wave along the rows as the pyramid's filter leaves it after many octaves: its amplitude times
  // (sin(w / 2) / (w / 2))^2, the limit of the [1 2 1] / 4 cascade. What shades is the slope of the wave that was there
  // as a mean over the vertex's cell, times sin(w / 2) / (w / 2): a plane through 3 x 3 posts would have 79 % of it.
  const double wave = 2 * std::numbers::pi / 6, cell = std::sin(wave / 2) / (wave / 2);
  const Field f = field(
      12, 0.5, 20, [&](int, int c) { return cell * cell * std::sin(wave * c); }, kFiltered);
  const double spacing_m = kDegree / 4096 * kMoonRadius_m * std::cos(lat_deg_of(f.block.extent.lat0) * kDegree);
  for (int c = 0; c <= 64; ++c) {
    const Vec3 normal = f.block.vertices[f.block.index(10, c)].normal.cast<double>();
    const EastNorthUp axes = local_axes(up(f.block, 10, c));
    ASSERT_NEAR(-normal.dot(axes.east) / normal.dot(axes.up), wave * std::cos(wave * c) / spacing_m * cell,
                0.02 * wave / spacing_m)
        << c;
  }
}

TEST(ShadingNormals, FilteredLevelsDependOnVoidsInRowAndColumnOnly) {
  const auto hills = [](int r, int c) { return 20 * std::sin(0.7 * r) * std::cos(0.9 * c); };
  const auto with_void = [&](int row, int column) {
    return field(
        12, 10, 20, [&](int r, int c) { return r == row && c == column ? std::nan("") : hills(r, c); }, kFiltered);
  };
  const auto normal = [](const Field& f) {
    return Vec3(f.block.vertices[f.block.index(30, 30)].normal.cast<double>());
  };
  const Field whole = field(12, 10, 20, hills, kFiltered), plane = field(12, 10, 20, hills);
  EXPECT_LT((normal(with_void(31, 31)) - normal(whole)).norm(), 1e-6);
  EXPECT_LT((normal(with_void(30, 32)) - normal(plane)).norm(), 1e-6);
  EXPECT_LT((normal(with_void(32, 30)) - normal(plane)).norm(), 1e-6);
  EXPECT_GT((normal(plane) - normal(whole)).norm(), 1e-2);
}

TEST(ShadingNormals, APoleHasTheVertical) {
  const Field f = field(8, 89.99, 20, [](int r, int c) { return 5.0 * r + c; });
  ASSERT_EQ(f.block.extent.lat1(), kLatTicks);
  for (int c = 0; c <= 64; ++c)
    ASSERT_LT((f.block.vertices[f.block.index(64, c)].normal.cast<double>() - Vec3::unit_z()).norm(), 1e-6);
}

}  // namespace
}  // namespace selenograph::dem
