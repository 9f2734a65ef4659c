// One triangle, one sample, one edge: what the kernels draw and what they put into shadow, against closed forms, at
// every width of vectors that the machine has.
#include "engine/visibility/zbuffer/raster_kernels.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <vector>

namespace selenograph::engine {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
constexpr float kDark = std::numeric_limits<float>::infinity();

// The widest vectors first, down to none.
void at_every_width(const std::function<void(const char* name)>& test) {
  std::int64_t newer = 0;  // a newer target has a lower bit
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::DisableTargets(newer);
    newer |= target;
    test(hwy::TargetName(target));
  }
  hwy::DisableTargets(0);
}

struct Point {
  float x, y, z;
};

// quads x rows quads of a block; vertices by row and column, from the south-west.
class Grid {
 public:
  Grid(int quads, int rows, const std::function<Point(int row, int column)>& vertex)
      : rows_(rows),
        stride_((quads + 1) / 16 * 16 + 16),
        xyz_(),
        vertices_(static_cast<std::size_t>((quads + 1) * (rows + 1))) {
    for (auto& axis : xyz_) axis.assign(static_cast<std::size_t>(stride_ * (rows + 1)) + 16, kNone);
    for (int r = 0; r <= rows; ++r)
      for (int c = 0; c <= quads; ++c) {
        const Point p = vertex(r, c);
        const auto at = static_cast<std::size_t>(r * stride_ + c);
        xyz_[0][at] = p.x, xyz_[1][at] = p.y, xyz_[2][at] = p.z;
      }
    block_ = {xyz_[0].data(), xyz_[1].data(), xyz_[2].data(), quads, stride_, vertices_.data()};
  }
  // Rows and columns are those of the first quad alone. Without d, one triangle.
  static Grid triangle(Point a, Point b, Point c, Point d = {kNone, kNone, kNone}) {
    return {1, 1, [&](int row, int column) { return row == 0 ? (column == 0 ? a : b) : column == 0 ? c : d; }};
  }
  const RasterBlock& block() const { return block_; }
  Strip strip(std::uint32_t block = 0) const { return {block, 0, rows_, {}, {}, {}}; }

 private:
  int rows_, stride_;
  std::array<std::vector<float>, 3> xyz_;
  std::vector<dem::Vertex> vertices_;
  RasterBlock block_;
};

// Pixels are x / z and y / z, nearness is 1 / z.
TileView square_view(int side) {
  TileView v{};
  for (int k = 0; k < 3; ++k) v.row[k][k] = 1;
  v.near0 = 1, v.width = v.height = side, v.least_depth = 0.01F;
  return v;
}

TileBuffer drawn(const Grid& grid, const TileView& view, bool in_float) {
  TileBuffer out;
  out.clear(view.width, view.height);
  draw_strip(grid.block(), grid.strip(), view, !in_float, out);
  return out;
}

std::size_t pixel(const TileView& view, int x, int y) { return static_cast<std::size_t>(y * view.width + x); }

TEST(DrawStrip, OneTriangleCoversTheSamplesInsideIt) {
  const TileView view = square_view(8);
  // In pixels (0.5, 0.5), (6.5, 0.5), (0.5, 6.5), two metres away.
  const Grid one = Grid::triangle({1, 1, 2}, {13, 1, 2}, {1, 13, 2});
  at_every_width([&](const char* name) {
    for (const bool in_float : {true, false}) {
      const TileBuffer out = drawn(one, view, in_float);
      for (int y = 0; y < 8; ++y)
        for (int x = 0; x < 8; ++x) {
          const bool inside = x >= 1 && y >= 1 && x + y <= 7;
          EXPECT_EQ(out.triangle[pixel(view, x, y)], inside ? TriangleId(0, 0, 0, false).packed() : kNoTriangle)
              << name << " " << in_float << ": " << x << ", " << y;
          EXPECT_EQ(out.nearness[pixel(view, x, y)], inside ? 0.5F : kFarthest);
        }
    }
  });
}

TEST(DrawStrip, ASampleOnTheSharedEdgeIsSeenOnce) {
  const TileView view = square_view(6);
  const Grid quad = Grid::triangle({0, 0, 1}, {4, 0, 1}, {0, 4, 1}, {4, 4, 1});
  at_every_width([&](const char* name) {
    for (const bool in_float : {true, false}) {
      const TileBuffer out = drawn(quad, view, in_float);
      for (int y = 0; y < 6; ++y)
        for (int x = 0; x < 6; ++x) {
          const std::uint32_t expected = x > 4 || y > 4 ? kNoTriangle : TriangleId(0, 0, 0, x + y > 4).packed();
          EXPECT_EQ(out.triangle[pixel(view, x, y)], expected) << name << " " << in_float << ": " << x << ", " << y;
        }
    }
  });
}

TEST(DrawStrip, NearnessIsLinearInTheImage) {
  const TileView view = square_view(32);
  // 1, 1/2 and 1/4 at the corners (0, 0), (30, 0) and (0, 30).
  const Grid slope = Grid::triangle({0, 0, 1}, {60, 0, 2}, {0, 120, 4});
  at_every_width([&](const char* name) {
    for (const bool in_float : {true, false}) {
      const TileBuffer out = drawn(slope, view, in_float);
      for (int y = 0; y <= 30; ++y)
        for (int x = 0; x + y <= 30; ++x)
          EXPECT_NEAR(out.nearness[pixel(view, x, y)], 1 - 0.5 * x / 30 - 0.75 * y / 30, 2e-7)
              << name << " " << in_float << ": " << x << ", " << y;
    }
  });
}

TEST(DrawStrip, TheNearerTriangleWinsInEitherOrder) {
  const TileView view = square_view(8);
  const Grid near = Grid::triangle({0, 0, 1}, {3, 0, 1}, {0, 3, 1}),
             far = Grid::triangle({0, 0, 2}, {14, 0, 2}, {0, 14, 2});
  at_every_width([&](const char* name) {
    for (const bool near_first : {true, false}) {
      TileBuffer out;
      out.clear(8, 8);
      for (const bool draws_near : {near_first, !near_first}) {
        const Grid& grid = draws_near ? near : far;
        draw_strip(grid.block(), grid.strip(draws_near ? 1 : 2), view, false, out);
      }
      EXPECT_EQ(TriangleId(out.triangle[pixel(view, 1, 1)]).block(), 1U) << name;
      EXPECT_EQ(TriangleId(out.triangle[pixel(view, 3, 3)]).block(), 2U) << name;
    }
  });
}

// Samples exactly on vertices, where six triangles are equally near; small triangles and large ones.
TEST(DrawStrip, OfEquallyNearTrianglesTheSameWinsAtEveryWidth) {
  for (const int spacing : {1, 2, 9}) {
    const int quads = 126 / spacing < 64 ? 126 / spacing : 64;
    const TileView view = square_view(128);
    const Grid flat(quads, 8, [&](int r, int c) {
      return Point{static_cast<float>(spacing * c), static_cast<float>(spacing * r), 1};
    });
    std::vector<std::uint32_t> first;
    at_every_width([&](const char* name) {
      const TileBuffer out = drawn(flat, view, true);
      EXPECT_EQ(std::count(out.triangle.begin(), out.triangle.end(), kNoTriangle) - static_cast<int>(kTilePadding),
                128 * 128 - (quads * spacing + 1) * (8 * spacing + 1))
          << name;
      if (first.empty()) first = out.triangle;
      EXPECT_EQ(out.triangle, first) << name << ", vertices " << spacing << " pixels apart";
    });
  }
}

TEST(DrawStrip, ATrianglePartlyBehindTheEyeIsSeenWhereItIsInFront) {
  // On the plane y = 1 below the eye: x from -8 to 8 at z = 4, to a point at z = -8. The image's middle is (16, 16).
  TileView view = square_view(32);
  view.row[0][2] = view.row[1][2] = 16;
  const Grid ground = Grid::triangle({-2, 1, 4}, {2, 1, 4}, {0, 1, -8});
  const TileBuffer out = drawn(ground, view, false);
  int seen = 0;
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 32; ++x) {
      // The ray (x - 16, y - 16, 1) t meets the plane at t = 1 / (y - 16), the triangle where |X| <= (Z + 8) / 6.
      const double t = 1.0 / (y - 16), across = (x - 16) * t;
      const bool inside = y > 16 && t <= 4 && std::abs(across) <= (t + 8) / 6;
      EXPECT_EQ(out.triangle[pixel(view, x, y)] != kNoTriangle, inside) << x << ", " << y;
      seen += inside;
      if (!inside) continue;
      EXPECT_NEAR(out.nearness[pixel(view, x, y)], y - 16, 1e-5);
    }
  EXPECT_GT(seen, 200);
}

TEST(GuardBand, EndsAtTheNearPlaneAndAtItsWidth) {
  EXPECT_TRUE(in_guard_band(0.01F, kGuardBand_px, -kGuardBand_px, 0.01F));
  EXPECT_FALSE(in_guard_band(0.009F, 0, 0, 0.01F));
  EXPECT_FALSE(in_guard_band(-1, 0, 0, 0.01F));
  EXPECT_FALSE(in_guard_band(1, 1.001F * kGuardBand_px, 0, 0.01F));
  EXPECT_FALSE(in_guard_band(1, kNone, 0, 0.01F)) << "no vertex";
}

// ---- the Sun -------------------------------------------------------------------------------------------------------

constexpr LightAxes kSunAbove{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};

// One cell of 8 x 8 m with these samples (u, v, d).
LightBand band_of(const std::vector<Point>& samples) {
  LightBand b{};
  b.per_u = b.per_v = 1 / 8.F, b.columns = b.rows = 1, b.margin_m = 1e-5F;
  b.start = {0, static_cast<std::uint32_t>(samples.size())};
  for (const Point& p : samples) b.u.push_back(p.x), b.v.push_back(p.y), b.d.push_back(p.z);
  for (int i = 0; i < 16; ++i) b.u.push_back(0), b.v.push_back(0), b.d.push_back(kDark);
  b.coarse_columns = 1, b.least.resize(1);
  find_least(b, 0, 0, 0, 0);
  return b;
}

bool shadows(const Grid& grid, const Point& sample) {
  LightBand band = band_of({sample});
  cast_strip(grid.block(), grid.strip(), kSunAbove, band);
  return band.d[0] == kDark;
}

TEST(CastStrip, OneBackFacingTriangleShadowsWhatLiesBeneathIt) {
  // Clockwise as the Sun sees it, one metre up.
  const Grid back = Grid::triangle({0, 0, 1}, {0, 4, 1}, {4, 0, 1}),
             front = Grid::triangle({0, 0, 1}, {4, 0, 1}, {0, 4, 1});
  at_every_width([&](const char* name) {
    EXPECT_TRUE(shadows(back, {1, 1, 0})) << name;
    EXPECT_TRUE(shadows(back, {0, 2, 0})) << name << ": on the edge";
    EXPECT_TRUE(shadows(back, {2, 2, 0})) << name << ": on the diagonal";
    EXPECT_FALSE(shadows(back, {3, 3, 0})) << name << ": beside it";
    EXPECT_FALSE(shadows(back, {1, 1, 2})) << name << ": above it";
    EXPECT_FALSE(shadows(back, {1, 1, 1})) << name << ": on it";
    EXPECT_FALSE(shadows(front, {1, 1, 0})) << name << ": facets that face the Sun cast none";
  });
}

TEST(CastStrip, ASlantedTriangleShadowsUpToItsPlane) {
  // d = 1 + u / 4
  const Grid slope = Grid::triangle({0, 0, 1}, {0, 4, 1}, {4, 0, 2});
  at_every_width([&](const char* name) {
    EXPECT_TRUE(shadows(slope, {2, 1, 1.499F})) << name;
    EXPECT_FALSE(shadows(slope, {2, 1, 1.501F})) << name;
  });
}

TEST(CastSkirt, ShadowsAsATriangleDoes) {
  const Skirt skirt{{0, 0, 1}, {0, 4, 1}, {4, 0, 1}};
  at_every_width([&](const char* name) {
    LightBand band = band_of({{1, 1, 0}, {3, 3, 0}, {1, 1, 2}});
    cast_skirt(skirt, kSunAbove, band);
    EXPECT_EQ(band.d[0], kDark) << name;
    EXPECT_EQ(band.d[1], 0) << name;
    EXPECT_EQ(band.d[2], 2) << name;
  });
}

TEST(LightBand, KnowsTheLeastOfItsSamples) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> any(-100, 100);
  for (std::size_t n = 1; n < 50; ++n) {
    std::vector<float> x(n);
    std::vector<Point> samples;
    for (float& value : x) value = any(random), samples.push_back({1, 1, value});
    const auto [least, most] = std::minmax_element(x.begin(), x.end());
    at_every_width([&, least = *least, most = *most](const char* name) {
      float low, high;
      range_of(x.data(), n, low, high);
      EXPECT_EQ(low, least) << name << ", " << n;
      EXPECT_EQ(high, most) << name << ", " << n;
      LightBand band = band_of(samples);
      EXPECT_EQ(band.least[0], least) << name << ", " << n;
      EXPECT_TRUE(band.any_below(0, 0, 0, 0, least + 1));
      EXPECT_FALSE(band.any_below(0, 0, 0, 0, least));
    });
  }
}

}  // namespace
}  // namespace selenograph::engine
