// Terrain where lattices and data have their corners: poles, the date line, four levels in one point, tiles that are
// missing, voids, spikes and walls.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dem/grid/lattice.h"
#include "tests/support/float_tiles.h"
#include "tests/support/frame_judge.h"
#include "tests/support/hard_views.h"
#include "tests/support/queries.h"
#include "tests/support/shared_data.h"
#include "tests/support/tiles.h"

namespace selenograph::test {
namespace {

using engine::Frame;
using engine::FrameRequest;

Findings expect_judged(const std::string& name, const Scenery& scenery, const FrameRequest& request) {
  SCOPED_TRACE(name);
  const Findings found = judged(*scenery.judge, request, scenery.renderer->render(request));
  report(name, found);
  EXPECT_EQ(found.off_ray + found.off_terrain + found.unexplained, 0u);
  EXPECT_LE(found.outlines * 1000, found.pixels);
  EXPECT_LE(found.wrong * 5000, found.flags);
  return found;
}

// An oblique look at a place on the ground from so many metres.
FrameRequest look_at(const Vec3& target, double azimuth_deg, double elevation_deg, double range_m, int side,
                     double fov_deg, const Vec3& sun) {
  const Vec3 back = local_direction(target, azimuth_deg, elevation_deg);
  return square_view(looking(target + range_m * back, -back, target), side, fov_deg, sun);
}

// ---- the date line -------------------------------------------------------------------------------------------------

TEST(HardTerrain, TheDateLineThroughTheImageCentre) {
  TemporaryFolder folder;
  for (const int west : {179, 180}) write_kaguya_tile(folder.path(), 41, west, 1, 256, crags);
  const Scenery scenery(folder.path());
  for (const double lon : {180.0, -180.0})
    for (const int side : {80, 81}) {  // the line between two columns of pixels, and through the middle of one
      const Findings found = expect_judged(fmt::format("date line as {}, {} px", lon, side), scenery,
                                           nadir_view({40.5, lon, 12000}, side, 70, local_sun(40.5, 180, 100, 8)));
      EXPECT_EQ(found.hits, found.pixels) << "no hole";
    }
  const Findings along =
      expect_judged("along the date line", scenery,
                    look_at(to_cartesian({40.5, 180, 0}), 180, 12, 15000, 81, 20, local_sun(40.5, 180, 270, 5)));
  EXPECT_GT(along.hits * 4, along.pixels * 3);
}

// ---- poles ---------------------------------------------------------------------------------------------------------

// Slopes up to 20 degrees, smooth across a pole.
double hills(const Vec3& direction) {
  const Vec3 p = direction * kMoonRadius_m / 1000;  // km
  return 150 * std::sin(2.1 * p.x() + 0.4) * std::sin(1.9 * p.y() + 1) + 40 * std::sin(5.3 * p.x() + 4.1 * p.y());
}

// Plane triangles between the posts that the lattice keeps around a pole, in double: the ring of blocks there, all of
// the longitude step that dem/grid/lattice.h documents.
class PolarCap {
 public:
  static constexpr int kLevel = 8;

  PolarCap(bool north, const std::function<double(const Vec3&)>& height_m) : north_(north) {
    const int row = north ? dem::rows_of(kLevel) - 1 : 0;
    columns_ = 360 * 256 >> dem::lon_shift(kLevel, row);
    rows_ = dem::quads_per_side(kLevel);
    for (int r = 0; r <= rows_; ++r)  // row 0 is the pole
      for (int c = 0; c < columns_; ++c) {
        const double lat = (north ? 1 : -1) * (90 - r / 256.0), lon = -180 + 360.0 * c / columns_;
        const Vec3 up = to_cartesian({lat, lon, 0}).normalized();
        posts_.push_back(up * (kMoonRadius_m + static_cast<double>(static_cast<float>(height_m(up)))));
      }
  }

  struct Meeting {
    double distance_m = std::numeric_limits<double>::infinity();
    Vec3 normal = Vec3::zero();
  };

  // The nearest triangle that a ray meets farther than `from_m`, by trying those near its way: a quad is at most 180 m
  // across.
  Meeting first(const Vec3& origin, const Vec3& direction, double from_m) const {
    constexpr double kNear_m = 250;
    Meeting nearest;
    for (int r = 0; r < rows_; ++r)
      for (int c = 0; c < columns_; ++c) {
        const Vec3 &inner = at(r, c), to = inner - origin;
        const double along = to.dot(direction);
        if (along < from_m - kNear_m || (to - along * direction).squared_norm() > kNear_m * kNear_m) continue;
        // The diagonal of a quad runs from its south-east to its north-west post.
        const Vec3 &next = at(r, c + 1), &outer = at(r + 1, c), &outer_next = at(r + 1, c + 1);
        if (north_) {
          meet(outer, outer_next, inner, origin, direction, from_m, nearest);
          meet(outer_next, next, inner, origin, direction, from_m, nearest);
        } else {
          meet(inner, next, outer, origin, direction, from_m, nearest);
          meet(next, outer_next, outer, origin, direction, from_m, nearest);
        }
      }
    return nearest;
  }

 private:
  const Vec3& at(int r, int c) const {
    return posts_[static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) +
                  static_cast<std::size_t>(c % columns_)];
  }

  // Möller and Trumbore (1997).
  static void meet(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& origin, const Vec3& direction,
                   double from_m, Meeting& nearest) {
    const Vec3 ab = b - a, ac = c - a, p = direction.cross(ac);
    const double determinant = ab.dot(p);
    if (determinant == 0) return;
    const Vec3 from_a = origin - a, q = from_a.cross(ab);
    const double v = from_a.dot(p) / determinant, w = direction.dot(q) / determinant,
                 distance = ac.dot(q) / determinant;
    constexpr double kSlack = 1e-9;
    if (v < -kSlack || w < -kSlack || v + w > 1 + kSlack || distance < from_m || distance >= nearest.distance_m) return;
    nearest = {distance, ab.cross(ac).normalized()};
  }

  bool north_;
  int columns_ = 0, rows_ = 0;
  std::vector<Vec3> posts_;
};

TEST(HardTerrain, BothPolesInPlaneTriangles) {
  for (const bool north : {true, false}) {
    TemporaryFolder folder;
    const double first_lat = north ? 90 : -89.75;
    write_float_tile(folder.path(), "cap", {first_lat, -180, 256, 65, 360 * 256}, [](double lat, double lon) {
      return hills(to_cartesian({lat, lon, 0}).normalized());
    });
    const engine::Renderer renderer(open_terrain(folder.path()), engine::RendererOptions{});
    const PolarCap cap(north, hills);
    const double pole = north ? 90 : -90;
    // Straight above, so that the middle of the image is the pole itself, turned so that its columns aren't meridians;
    // and from aside, 25 degrees high.
    const Vec3 sun = local_sun(pole, 0, 75, 6), place = to_cartesian({pole, 0, 0}),
               above = to_cartesian({pole, 0, 6000});
    for (const auto& [name, request] :
         {std::pair("above", square_view(looking(above, -above, local_direction(above, 33, 0)), 23, 40, sun)),
          std::pair("from aside", look_at(place, 130, 25, 4000, 22, 25, sun))}) {
      const Frame frame = renderer.render(request);
      std::size_t hits = 0, lit = 0, wrong = 0;
      double worst = 0;
      for (std::size_t i = 0; i < frame.products.depth.size(); ++i) {
        const int x = static_cast<int>(i) % request.camera.width, y = static_cast<int>(i) / request.camera.width;
        const Vec3 in_camera((x - request.camera.cx) / request.camera.fx, (y - request.camera.cy) / request.camera.fy,
                             1);
        const Vec3 direction = (request.pose.camera_from_moon.conjugate() * in_camera).normalized();
        const Vec3& eye = request.pose.position_m;
        const PolarCap::Meeting truth = cap.first(eye, direction, 0);
        ASSERT_TRUE(std::isfinite(truth.distance_m)) << "the cap is too small for the view";
        ASSERT_FALSE(std::isnan(frame.products.depth[i])) << "a hole at pixel " << x << ' ' << y;
        ++hits;
        const Vec3 point = at3(frame.products.position, i);
        worst = std::max(worst, (point - (eye + truth.distance_m * direction)).norm());
        const bool faces = truth.normal.dot(sun) > 0 && at3(frame.products.normal, i).dot(sun) > 0;
        const bool free = faces && !std::isfinite(cap.first(point, sun, 1e-4).distance_m);
        if (std::abs(truth.normal.dot(sun)) < 2e-4) continue;  // within centimetres of grazing
        if (point.xy().norm() < 1e-6) continue;                // on the pole: any of thousands of triangles
        lit += free, wrong += free != (frame.products.lit[i] > 0);
      }
      fmt::print("{} pole {:10}  hits {:4}  off by {:.1e} m at most  lit {:4}  wrong {}\n", north ? "north" : "south",
                 name, hits, worst, lit, wrong);
      EXPECT_LT(worst, 1e-6);
      EXPECT_EQ(wrong, 0u);
      EXPECT_GT(lit, hits / 10);
      EXPECT_GT(hits - lit, hits / 10);
    }
  }
}

// From far above the equator both poles lie on the limb; mountains there make them seen. The terrain is its own mirror
// image, so the frame is too, to within the level of detail (the diagonals of quads are not mirrored).
TEST(HardTerrain, BothPolesInOneView) {
  TemporaryFolder folder;
  write_global_tile(folder.path(), 4, [](double lat, double) {
    const double off = (90 - std::abs(lat)) / 2;
    return 6000 * std::exp(-off * off);
  });
  const engine::Renderer renderer(open_terrain(folder.path()), engine::RendererOptions{});
  for (const double lon : {180.0, 77.7}) {
    constexpr std::size_t kWidth = 32, kHeight = 3072;
    FrameRequest request = nadir_view({0, lon, 400e6}, kHeight, 0.52, local_sun(0, lon, 90, 60));
    request.camera.width = kWidth, request.camera.cx = (kWidth - 1) / 2.0;
    request.accuracy.max_error_px = 0.25;
    const Frame frame = renderer.render(request);
    std::size_t unpaired = 0, seen = 0;
    double worst_m = 0, north = -1e9, south = 1e9;
    for (std::size_t y = 0; y < kHeight / 2; ++y)
      for (std::size_t x = 0; x < kWidth; ++x) {
        const Vec3 up = at3(frame.products.position, y * kWidth + x),
                   down = at3(frame.products.position, (kHeight - 1 - y) * kWidth + x);
        if (std::isnan(up.x()) != std::isnan(down.x())) ++unpaired;
        if (std::isnan(up.x()) || std::isnan(down.x())) continue;
        ++seen;
        north = std::max(north, up.z()), south = std::min(south, down.z());
        // Along the line of sight a height error is stretched towards the limb: compared as heights, then.
        worst_m = std::max(worst_m, std::abs(up.norm() - down.norm()));
      }
    fmt::print(
        "both poles from above 0 N {} E: {} pairs of pixels, {} unpaired, heights differ by {:.1f} m at most (bound "
        "{:.1f} m), seen up to z = {:.1f} and {:.1f} km\n",
        lon, seen, unpaired, worst_m, 2 * frame.report.lod_error_m, north / 1000, south / 1000);
    EXPECT_LE(unpaired, 4u);
    EXPECT_GT(seen, 40000u);
    EXPECT_LT(worst_m, 2 * frame.report.lod_error_m);
    EXPECT_GT(north, kMoonRadius_m + 3000) << "the top of the north pole's mountain isn't seen";
    EXPECT_LT(south, -kMoonRadius_m - 3000);
    EXPECT_EQ(frame.report.missing_fraction, 0);
  }
}

// ---- levels and tiles ----------------------------------------------------------------------------------------------

// Four products of 118, 59, 30 and 15 m that meet in one point, over hills that all of them resolve.
struct Quarter {
  const char* name;
  int level;
  bool north, east;
};
constexpr std::array kQuarters{Quarter{"a", 8, true, false}, Quarter{"b", 9, true, true}, Quarter{"c", 10, false, true},
                               Quarter{"d", 11, false, false}};
constexpr double kCornerLat = 20, kCornerLon = 50;
double resolved_hills(double lat, double lon) { return 60 * std::sin(20 * lat) * std::cos(18 * lon) + 500; }

void expect_exact_posts_around_the_corner(const engine::Renderer& renderer) {
  std::vector<engine::Ray> rays;
  std::vector<double> heights;
  for (const Quarter& q : kQuarters)
    for (const int j : {0, 1, 7, 20})
      for (const int i : {0, 1, 5, 13}) {
        const double lat = kCornerLat + (q.north ? 1 : -1) * j / static_cast<double>(1 << q.level),
                     lon = kCornerLon + (q.east ? 1 : -1) * i / static_cast<double>(1 << q.level);
        const Vec3 from = to_cartesian({lat, lon, 3000});
        rays.push_back({from, -from.normalized()}),
            heights.push_back(static_cast<double>(static_cast<float>(resolved_hills(lat, lon))));
      }
  const auto hits = test::cast_rays(renderer, rays);
  double worst = 0;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    ASSERT_TRUE(hits[i].hit);
    worst = std::max(worst, std::abs(3000 - hits[i].range_m - heights[i]));
  }
  fmt::print("posts around the corner of four levels: off by {:.1e} m at most\n", worst);
  EXPECT_LT(worst, 1e-6);
}

// The finest mesh is continuous there, names each product in its quarter, and stays within what chords leave of the
// hills; at the posts themselves nothing is left of it.
TEST(HardTerrain, FourLevelsInOneCorner) {
  constexpr double kLat = kCornerLat, kLon = kCornerLon, kSize = 0.25;
  TemporaryFolder folder;
  for (const Quarter& q : kQuarters) {
    const int n = static_cast<int>(kSize * (1 << q.level)) + 1;
    write_float_tile(
        folder.path(), q.name,
        {kLat + (q.north ? kSize : 0), kLon - (q.east ? 0 : kSize), static_cast<double>(1 << q.level), n, n},
        resolved_hills);
  }
  const engine::Renderer renderer(open_terrain(folder.path()), engine::RendererOptions{});
  // 60 (20 k)^2 + 60 (18 k)^2 with k = 180 / (pi R), over the coarsest posts; the chords' sag besides.
  const double k = 180 / (std::numbers::pi * kMoonRadius_m), bend = 60 * (20 * 20 + 18 * 18) * k * k,
               post = dem::post_spacing_m(8), tolerance_m = bend * post * post / 4 + dem::chord_sag_m(8);
  for (const bool nadir : {true, false}) {
    const Vec3 corner = to_cartesian({kLat, kLon, 500}), sun = local_sun(kLat, kLon, 60, 30);
    FrameRequest request =
        nadir ? nadir_view({kLat, kLon, 4000}, 121, 60, sun) : look_at(corner, 45, 35, 4000, 121, 30, sun);
    request.products |= engine::kSource | engine::kGsd | engine::kGeodetic;
    const Frame frame = renderer.render(request);
    ASSERT_EQ(frame.report.sources.size(), 4u);
    EXPECT_EQ(frame.report.hit_fraction, 1) << "no hole";
    EXPECT_EQ(frame.report.filled_fraction, 0);
    double worst = 0;
    std::array<std::size_t, 4> seen{};
    for (std::size_t i = 0; i < frame.products.lit.size(); ++i) {
      const double lat = frame.products.geodetic[3 * i], lon = frame.products.geodetic[3 * i + 1];
      worst = std::max(worst, std::abs(frame.products.geodetic[3 * i + 2] - resolved_hills(lat, lon)));
      ASSERT_EQ(frame.products.lit[i], 1.F) << "no slope of these shades another";
      // A post aside of the borders.
      if (std::min(std::abs(lat - kLat), std::abs(lon - kLon)) < 1.0 / 256) continue;
      const auto at = std::find_if(kQuarters.begin(), kQuarters.end(),
                                   [&](const Quarter& q) { return q.north == (lat > kLat) && q.east == (lon > kLon); });
      ++seen[static_cast<std::size_t>(at - kQuarters.begin())];
      ASSERT_EQ(frame.report.sources[frame.products.source[i]].name, at->name) << lat << ' ' << lon;
      // Balanced: beside a finer neighbour a quarter may be subdivided, never coarser than its posts.
      ASSERT_LE(static_cast<double>(frame.products.gsd[i]), dem::post_spacing_m(at->level) * (1 + 1e-6));
    }
    fmt::print("four levels in a corner, {}: pixels {} {} {} {}, heights off by {:.1e} m at most (chords: {:.1e} m)\n",
               nadir ? "nadir" : "oblique", seen[0], seen[1], seen[2], seen[3], worst, tolerance_m);
    EXPECT_LT(worst, tolerance_m);
    for (const std::size_t n : seen) EXPECT_GT(n, 300u);
  }
  expect_exact_posts_around_the_corner(renderer);
}

// ---- what isn't there ----------------------------------------------------------------------------------------------

// Where a pixel without a hit looks: on the datum, in posts from the mosaic's south-west corner.
std::optional<Geographic> datum_place(const FrameRequest& request, std::size_t pixel) {
  const engine::Camera& c = request.camera;
  const auto width = static_cast<std::size_t>(c.width);
  const Vec3 in_camera((static_cast<double>(pixel % width) - c.cx) / c.fx,
                       (static_cast<double>(pixel / width) - c.cy) / c.fy, 1);
  const Vec3 d = (request.pose.camera_from_moon.conjugate() * in_camera).normalized(), &o = request.pose.position_m;
  const double along = o.dot(d), root = along * along - o.squared_norm() + kMoonRadius_m * kMoonRadius_m;
  if (root < 0 || along > 0) return std::nullopt;
  return to_geographic(o - (along + std::sqrt(root)) * d);
}

TEST(HardTerrain, AMissingNeighbourTile) {
  TemporaryFolder folder;  // the north-eastern one of four
  write_kaguya_tile(folder.path(), 11, 20, 1, 256, crags);
  write_kaguya_tile(folder.path(), 10, 20, 1, 256, crags);
  write_kaguya_tile(folder.path(), 10, 21, 1, 256, crags);
  const Scenery scenery(folder.path());
  for (const double elevation : {30.0, 4.0}) {
    const FrameRequest request = nadir_view({10, 21, 15000}, 96, 70, local_sun(10, 21, 40, elevation));
    const Findings found = expect_judged(fmt::format("missing tile, Sun at {} deg", elevation), scenery, request);
    EXPECT_EQ(found.unknown, 0u);
    const Frame frame = scenery.renderer->render(request);
    EXPECT_NEAR(frame.report.missing_fraction, 0.25, 0.03);
    EXPECT_NEAR(frame.report.hit_fraction + frame.report.missing_fraction, 1, 1e-12);
    EXPECT_EQ(frame.report.filled_fraction, 0) << "nothing is made up for a tile that isn't there";
    for (std::size_t i = 0; i < frame.products.depth.size(); ++i) {
      if (!std::isnan(frame.products.depth[i])) continue;
      const auto place = datum_place(request, i);
      ASSERT_TRUE(place && place->lat_deg > 9.95 && place->lon_deg > 20.95);
    }
  }
}

TEST(HardTerrain, AVoidOfOnePost) {
  constexpr double kLat = 10.5, kLon = 20.5;
  const auto is_void = [](double lat, double lon) { return lat == kLat && lon == kLon; };
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 11, 20, 1, 256, crags, is_void);
  const Scenery scenery(folder.path());
  FrameRequest request = nadir_view({kLat, kLon, 1500}, 97, 40, local_sun(kLat, kLon, 40, 12));
  request.products |= engine::kSource;
  const Findings found = expect_judged("void of one post", scenery, request);
  EXPECT_GT(found.unknown, 0u) << "the judge doesn't know voids";
  const Frame frame = scenery.renderer->render(request);
  EXPECT_EQ(frame.report.hit_fraction, 1);
  EXPECT_EQ(frame.report.missing_fraction, 0);
  // What stands on it: the six triangles around it. In posts from the void they are |u| < 1, |v| < 1, |u + v| < 1.
  double low = 1e9, high = -1e9, filled = 0, borderline = 0;
  for (const auto& [dy, dx] : {std::pair(0, 1), {0, -1}, {1, 0}, {-1, 0}}) {
    const double h = std::round(crags(kLat + dy / 256.0, kLon + dx / 256.0));
    low = std::min(low, h), high = std::max(high, h);
  }
  for (std::size_t i = 0; i < frame.products.depth.size(); ++i) {
    ASSERT_EQ(frame.products.source[i], 0) << "a filled post names its neighbour's tile";
    const Vec3 p = at3(frame.products.position, i);
    const Geographic g = to_geographic(p);
    const double u = (g.lon_deg - kLon) * 256, v = (g.lat_deg - kLat) * 256,
                 out = std::max({std::abs(u), std::abs(v), std::abs(u + v)});
    filled += out < 1, borderline += std::abs(out - 1) < 1e-4;
    if (out >= 1) continue;
    const auto corner = [&](int dy, int dx) { return std::round(crags(kLat + dy / 256.0, kLon + dx / 256.0)); };
    const double most = std::max({high, corner(1, -1), corner(-1, 1)}),
                 least = std::min({low, corner(1, -1), corner(-1, 1)});
    ASSERT_TRUE(g.height_m > least - 0.01 && g.height_m < most + 0.01) << g.height_m;
  }
  const double pixels = 97 * 97;
  fmt::print("void of one post: {:.0f} of {:.0f} pixels stand on it, {:.0f} are flagged\n", filled, pixels,
             frame.report.filled_fraction * pixels);
  EXPECT_GT(filled, 50);
  EXPECT_NEAR(frame.report.filled_fraction * pixels, filled, borderline + 1e-6);
  // The mean of its four neighbours, by one rule for rows and columns.
  const auto height = scenery.terrain->height(kLat, kLon);
  EXPECT_TRUE(height.filled);
  double mean = 0;
  for (const auto& [dy, dx] : {std::pair(0, 1), {0, -1}, {1, 0}, {-1, 0}})
    mean += std::round(crags(kLat + dy / 256.0, kLon + dx / 256.0)) / 4;
  EXPECT_NEAR(height.height_m, mean, 1e-3);
}

// ---- spikes and walls ----------------------------------------------------------------------------------------------

// Pairs of neighbouring posts at +9000 and -9000 m, along a row, a column and both diagonals: slopes of 89.9 degrees.
TEST(HardTerrain, SpikesBetweenNeighbouringPosts) {
  constexpr int kPpd = 1024;
  const auto spikes = [](double lat, double lon) {
    const int r = static_cast<int>(std::lround((lat - 10) * kPpd)),
              c = static_cast<int>(std::lround((lon - 20) * kPpd));
    struct Spike {
      int r, c;
      double height_m;
    };
    for (const Spike& s : {Spike{512, 512, 9000},
                           {512, 513, -9000},
                           {540, 500, 9000},
                           {541, 500, -9000},
                           {480, 540, -9000},
                           {481, 541, 9000},
                           {470, 490, 9000},
                           {471, 489, -9000},
                           {520, 470, 9000},
                           {500, 560, -9000}})
      if (r == s.r && c == s.c) return s.height_m;
    return 0.2 * crags(lat, lon);
  };
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 11, 20, 1, kPpd, spikes);
  const Scenery scenery(folder.path());
  const Vec3 middle = to_cartesian({10.5, 20.5, 0});
  for (const double elevation : {3.0, 25.0, 89.0}) {
    const Vec3 sun = local_sun(10.5, 20.5, 250, elevation);
    const Findings nadir = expect_judged(fmt::format("spikes, nadir, Sun at {} deg", elevation), scenery,
                                         nadir_view({10.5, 20.5, 14000}, 96, 30, sun)),
                   oblique = expect_judged(fmt::format("spikes, oblique, Sun at {} deg", elevation), scenery,
                                           look_at(middle, 160, 25, 12000, 96, 50, sun));
    EXPECT_EQ(nadir.hits, nadir.pixels) << "no hole";
    EXPECT_GT(oblique.hits, oblique.pixels / 2);
  }
  // From half a kilometre above the plain, among them.
  expect_judged("among the spikes", scenery,
                square_view(looking(to_cartesian({10.5, 20.47, 500}), local_direction(middle, 80, 20), middle), 96, 90,
                            local_sun(10.5, 20.5, 250, 25)));
}

// A plateau 8000 m above the plain, with walls one post wide along a meridian, along a parallel and aslant.
TEST(HardTerrain, Walls) {
  constexpr int kPpd = 1024;
  const auto plateau = [](double lat, double lon) {
    const bool up = lon > 20.5 && lat > 10.5 && lat + lon < 31.05;
    return 0.1 * crags(lat, lon) + (up ? 8000 : 0);
  };
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 11, 20, 1, kPpd, plateau);
  const Scenery scenery(folder.path());
  const Vec3 corner = to_cartesian({10.5, 20.5, 4000});
  for (const auto& [azimuth, elevation] : {std::pair(260.0, 20.0), {80.0, 20.0}, {0.0, 60.0}}) {
    const Vec3 sun = local_sun(10.5, 20.5, azimuth, elevation);
    expect_judged(fmt::format("wall from above, Sun {} {}", azimuth, elevation), scenery,
                  nadir_view({10.5, 20.5, 15000}, 96, 50, sun));
    const Findings facing = expect_judged(fmt::format("wall from the front, Sun {} {}", azimuth, elevation), scenery,
                                          look_at(corner, 225, 2, 9000, 96, 50, sun));
    EXPECT_GT(facing.hits, facing.pixels / 3);
    expect_judged(fmt::format("along the wall, Sun {} {}", azimuth, elevation), scenery,
                  look_at(to_cartesian({10.52, 20.5, 3000}), 180, 1, 3000, 96, 60, sun));
  }
  expect_judged("wall from its edge, down", scenery,
                square_view(looking(to_cartesian({10.52, 20.5003, 8060}), -corner, local_axes(corner).north), 96, 120,
                            local_sun(10.5, 20.5, 260, 20)));
}

}  // namespace
}  // namespace selenograph::test
