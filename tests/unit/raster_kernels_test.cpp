// One triangle, one sample, one edge: what the kernels draw and what they put into shadow, against closed forms, at
// every width of vectors that the machine has.
#include "engine/visibility/zbuffer/raster_kernels.h"

#include "dem/base/vector_targets.h"
// Highway's headers come after it: which sets of vectors they know depends on it.
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <tuple>
#include <vector>

#include "dem/grid/geodesy.h"

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
  v.near0 = 1, v.width = v.height = side, v.min_depth_m = 0.01F;
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

// Rows exposed one after the other while the image moves to the right and down, and grows: x / z is 0.1 r to the right
// of column / depth in the row r below the middle one, y / z 0.125 r below, and z decreases by a hundredth per row.
RowMotion moving_rows(int side) {
  RowMotion motion{};
  const float middle = static_cast<float>(side / 2);
  motion.column[0][0] = motion.depth[0][2] = motion.off_row[0][1] = 1;
  motion.off_row[0][2] = -middle;
  motion.column[1][2] = 0.1F;
  motion.depth[1][3] = -0.01F;
  motion.off_row[1][2] = 0.125F - 1;  // of y, less one row's depth
  motion.off_row[1][3] = 0.01F * middle;
  motion.off_row[2][3] = 0.01F;
  motion.middle = middle;
  motion.reach = middle + 8;
  return motion;
}

// Returns the pixel at which a point is imaged in the row of that time.
std::array<double, 2> imaged_at(const Point& p, int side) {
  const double x = static_cast<double>(p.x), y = static_cast<double>(p.y), z = static_cast<double>(p.z);
  double r = 0;
  for (int step = 0; step < 50; ++step) r = (y + 0.125 * r * z) / (z - 0.01 * r) - side / 2;
  return {(x + 0.1 * r * z) / (z - 0.01 * r), r + side / 2};
}

TEST(DrawStrip, EachVertexOfMovingRowsHasTheTimeOfItsRow) {
  constexpr int kSide = 64;
  const RowMotion motion = moving_rows(kSide);
  TileView view = square_view(kSide);
  view.motion = &motion;
  // One triangle, 10 metres away: compared with the triangle of its corners' own pixels.
  const Point corners[3] = {{50, 60, 10}, {420, 130, 10}, {140, 480, 10}};
  std::array<double, 2> at[3];
  for (int k = 0; k < 3; ++k) at[k] = imaged_at(corners[k], kSide);
  const Grid one = Grid::triangle(corners[0], corners[1], corners[2]);
  at_every_width([&](const char* name) {
    for (const bool in_float : {true, false}) {
      const TileBuffer out = drawn(one, view, in_float);
      int covered = 0;
      for (int y = 0; y < kSide; ++y)
        for (int x = 0; x < kSide; ++x) {
          double least = 1e9;  // distance inside the nearest edge, pixels
          for (int k = 0; k < 3; ++k) {
            const auto &a = at[k], &b = at[(k + 1) % 3];
            const double cross = (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]);
            least = std::min(least, cross / std::hypot(b[0] - a[0], b[1] - a[1]));
          }
          if (std::abs(least) < 2e-3) continue;
          covered += least > 0;
          EXPECT_EQ(out.triangle[pixel(view, x, y)], least > 0 ? TriangleId(0, 0, 0, false).packed() : kNoTriangle)
              << name << " " << in_float << ": " << x << ", " << y;
        }
      EXPECT_GT(covered, 500);
    }
  });
}

TEST(DrawStrip, MovingRowsHaveNoHolesBetweenStripsAndSingleTriangles) {
  constexpr int kSide = 64;
  const RowMotion motion = moving_rows(kSide);
  TileView view = square_view(kSide);
  view.motion = &motion;
  std::mt19937 random(1);
  std::uniform_real_distribution<float> offset(-8, 8);
  const Grid ground(64, 64, [&](int r, int c) {
    return Point{-200 + 20 * static_cast<float>(c) + offset(random), -200 + 20 * static_cast<float>(r) + offset(random),
                 10 + offset(random) / 40};
  });
  std::vector<std::uint32_t> first;
  at_every_width([&](const char* name) {
    for (const bool in_float : {true, false}) {
      const TileBuffer out = drawn(ground, view, in_float);
      EXPECT_EQ(std::count(out.triangle.begin(), out.triangle.end(), kNoTriangle), static_cast<int>(kTilePadding))
          << name << " " << in_float;
      if (first.empty()) first = out.triangle;
      if (in_float) {
        EXPECT_EQ(out.triangle, first) << name;
      }
    }
  });
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
  b.coarse_columns = 1, b.min_d.resize(1);
  update_coarse_min(b, 0, 0, 0, 0);
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

// Ground 8 km above the anchor, where float resolves half a millimetre. The Sun is in the east, 3 degrees up. Eastward
// the ground rises by 2 degrees, by 3.2 degrees from the foot at 100 m to the crest at 200 m, and then falls.
class ValleyAndRidge {
 public:
  static constexpr double kFoot_m = 100, kCrest_m = 200;

  ValleyAndRidge()
      : grid_(3, 3, [](int r, int c) {
          const double x = 100 * c;
          const double y = 100 * r;
          return Point{static_cast<float>(x), static_cast<float>(y), static_cast<float>(height(x) + rise(y))};
        }) {
    const double sun = kSun_deg * kRadiansPerDegree;
    east_ = std::cos(sun);
    up_ = std::sin(sun);
    axes_ = {{static_cast<float>(-up_), 0, static_cast<float>(east_)},
             {0, -1, 0},
             {static_cast<float>(east_), 0, static_cast<float>(up_)}};
  }
  static double height(double x) {
    const auto slope = [](double degrees) { return std::tan(degrees * kRadiansPerDegree); };
    if (x <= kFoot_m) return kBase_m + slope(2) * (x - kFoot_m);
    if (x <= kCrest_m) return kBase_m + slope(3.2) * (x - kFoot_m);
    return kBase_m + slope(3.2) * (kCrest_m - kFoot_m) - slope(2) * (x - kCrest_m);
  }
  // The ground rises northward, too: in light space no edge runs along an axis.
  static double rise(double y) { return 0.07 * y; }
  // Returns the number of points in shadow among 1000 at (x, y, z + rise(y)), spread along y.
  std::size_t shadowed(double x, double z) const {
    std::vector<Point> samples;
    for (int i = 0; i < 1000; ++i) {
      const double y = 100.01 + 0.09 * i;
      const double up_m = z + rise(y);
      samples.push_back({static_cast<float>(east_ * up_m - up_ * x), static_cast<float>(-y),
                         static_cast<float>(east_ * x + up_ * up_m)});
    }
    LightBand band = band_of(samples);
    band.u0 = 7000, band.v0 = -1000, band.per_u = band.per_v = 1 / 2000.F;
    cast_strip(grid_.block(), grid_.strip(), axes_, band);
    return static_cast<std::size_t>(std::count(band.d.begin(), band.d.begin() + 1000, kDark));
  }
  std::size_t shadowed_on_ground(double x) const { return shadowed(x, height(x)); }
  // Returns likewise for points on the Sun's ray that passes `above_m` over the crest, `beyond_m` west of it.
  std::size_t shadowed_behind_crest(double beyond_m, double above_m) const {
    const double x = kCrest_m - beyond_m;
    return shadowed(x, height(kCrest_m) + above_m - beyond_m * up_ / east_);
  }

 private:
  static constexpr double kSun_deg = 3, kBase_m = 8000;
  Grid grid_;
  double east_, up_;
  LightAxes axes_;
};

TEST(CastStrip, GroundNextToTheFootOfASlopeIsInShadow) {
  const ValleyAndRidge ground;
  at_every_width([&](const char* name) {
    for (const double from_foot_m : {3e-3, 0.01, 0.03, 0.1, 1.0, 3.0})
      EXPECT_EQ(ground.shadowed_on_ground(ValleyAndRidge::kFoot_m - from_foot_m), 1000U) << name << ", " << from_foot_m;
  });
}

TEST(CastStrip, RoundingAtACrestShadowsNothingElse) {
  const ValleyAndRidge ground;
  at_every_width([&](const char* name) {
    for (const double from_crest_m : {0.003, 0.1, 1.0, 10.0})
      EXPECT_EQ(ground.shadowed_on_ground(ValleyAndRidge::kCrest_m + from_crest_m), 0U) << name << ", " << from_crest_m;
    for (const double beyond_m : {120.0, 500.0}) {
      EXPECT_EQ(ground.shadowed_behind_crest(beyond_m, 0.002), 0U) << name << ", " << beyond_m;
      EXPECT_EQ(ground.shadowed_behind_crest(beyond_m, -0.002), 1000U) << name << ", " << beyond_m;
    }
  });
}

// What bound_occluders() finds, triangle by triangle.
std::vector<LightBox> bounds_by_triangle(const Grid& grid, const LightAxes& axes) {
  const RasterBlock& b = grid.block();
  const int rows = grid.strip().rows;
  const auto at = [&](int r, int c) -> Point {
    const auto k = static_cast<std::size_t>(r * b.stride + c);
    const auto along = [&](const float* axis) { return axis[0] * b.x[k] + (axis[1] * b.y[k] + axis[2] * b.z[k]); };
    return {along(axes.u), along(axes.v), along(axes.d)};
  };
  std::vector<LightBox> boxes;
  for (int r0 = 0; r0 < rows; r0 += kOccluderBoxQuads)
    for (int c0 = 0; c0 < b.quads; c0 += kOccluderBoxQuads) {
      LightBox box{kDark, -kDark, kDark, -kDark, -kDark};
      for (int r = r0; r < std::min(r0 + kOccluderBoxQuads, rows); ++r)
        for (int c = c0; c < std::min(c0 + kOccluderBoxQuads, b.quads); ++c)
          for (const bool upper : {false, true}) {
            const Point south_east = at(r, c + 1), north_west = at(r + 1, c);
            const Point p = upper ? at(r + 1, c + 1) : at(r, c), q = upper ? north_west : south_east,
                        s = upper ? south_east : north_west;
            const float area = (q.x - p.x) * (s.y - p.y) - (q.y - p.y) * (s.x - p.x);
            if (!(area < 0)) continue;  // it faces the Sun, or lacks a vertex
            for (const Point& corner : {p, q, s}) {
              box.u_low = std::min(box.u_low, corner.x);
              box.u_high = std::max(box.u_high, corner.x);
              box.v_low = std::min(box.v_low, corner.y);
              box.v_high = std::max(box.v_high, corner.y);
              box.d_high = std::max(box.d_high, corner.z);
            }
          }
      if (box.u_low <= box.u_high) boxes.push_back(box);
    }
  return boxes;
}

void expect_bounds_as_by_triangle(const Grid& grid, const LightAxes& axes, std::size_t parts) {
  const std::vector<LightBox> expected = bounds_by_triangle(grid, axes);
  EXPECT_EQ(expected.size(), parts);
  at_every_width([&](const char* name) {
    LightBox found[kMaxOccluderBoxes];
    ASSERT_EQ(bound_occluders(grid.block(), grid.strip(), axes, found), expected.size()) << name;
    for (std::size_t i = 0; i < expected.size(); ++i) {
      EXPECT_EQ(found[i].u_low, expected[i].u_low) << name;
      EXPECT_EQ(found[i].u_high, expected[i].u_high) << name;
      EXPECT_EQ(found[i].v_low, expected[i].v_low) << name;
      EXPECT_EQ(found[i].v_high, expected[i].v_high) << name;
      EXPECT_EQ(found[i].d_high, expected[i].d_high) << name;
    }
  });
}

// The Sun is in the east, 36.9 degrees up.
constexpr LightAxes kSunInTheEast{{0.6F, 0, -0.8F}, {0, 1, 0}, {0.8F, 0, 0.6F}};

TEST(BoundOccluders, PartsAreBoundedByTheirTrianglesThatFaceAway) {
  std::mt19937 random(2);
  std::uniform_real_distribution<float> height(0, 2);
  for (const auto& [quads, rows, parts] : {std::tuple(64, 16, 16U), {61, 13, 16U}, {5, 3, 1U}, {16, 9, 4U}}) {
    const Grid rough(quads, rows, [&](int r, int c) {
      const float z = height(random);
      return Point{static_cast<float>(c), static_cast<float>(r), z < 0.1F ? kNone : z};
    });
    expect_bounds_as_by_triangle(rough, kSunInTheEast, parts);
  }
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
      EXPECT_EQ(band.min_d[0], least) << name << ", " << n;
      EXPECT_TRUE(band.any_below(0, 0, 0, 0, least + 1));
      EXPECT_FALSE(band.any_below(0, 0, 0, 0, least));
    });
  }
}

}  // namespace
}  // namespace selenograph::engine
