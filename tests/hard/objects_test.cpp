// Objects over the terrain and alone, before a judge that tries every triangle in double; and both ways to see before
// each other.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>

#include "engine/camera/view.h"
#include "engine/visibility/objects/object_mesh.h"
#include "tests/support/meshes.h"
#include "tests/support/queries.h"
#include "tests/support/sample_scenery.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

using test::at3;

constexpr char kSatellite[] = SELENOGRAPH_SOURCE_DIR "/deploy/assets/objects/satellite.obj";
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Every object's triangles in MOON_ME.
class ObjectJudge {
 public:
  explicit ObjectJudge(const std::vector<SceneObject>& objects) {
    for (std::size_t k = 0; k < objects.size(); ++k) {
      const SceneObject& o = objects[k];
      const auto place = [&](const Vec3& p) -> Vec3 { return o.position_m + o.moon_from_object * Vec3(o.scale * p); };
      const ObjectShape& shape = o.mesh->shape();
      for (const ObjectTriangle& t : shape.triangles)
        triangles_.push_back({place(shape.place(t, 0)), place(shape.place(t, 1)), place(shape.place(t, 2)),
                              static_cast<std::uint16_t>(k)});
    }
  }

  struct Answer {
    double distance = kInfinity;
    std::uint16_t object = 65535;
    // How near the ray passes to the border of any triangle, m: there float may decide otherwise.
    double to_border_m = kInfinity;
  };

  // The nearest triangle farther than `from` along a unit direction.
  Answer look(const Vec3& origin, const Vec3& direction, double from) const {
    Answer answer;
    for (const Triangle& t : triangles_) {
      answer.to_border_m = std::min({answer.to_border_m, apart(origin, direction, t.a, t.b),
                                     apart(origin, direction, t.b, t.c), apart(origin, direction, t.c, t.a)});
      // Moeller & Trumbore 1997.
      const Vec3 ab = t.b - t.a, ac = t.c - t.a, p = direction.cross(ac);
      const double determinant = ab.dot(p);
      if (determinant == 0) continue;
      const Vec3 s = origin - t.a, q = s.cross(ab);
      const double u = s.dot(p) / determinant, v = direction.dot(q) / determinant, d = ac.dot(q) / determinant;
      if (u >= 0 && v >= 0 && u + v <= 1 && d > from && d < answer.distance)
        answer.distance = d, answer.object = t.object;
    }
    return answer;
  }

 private:
  struct Triangle {
    Vec3 a, b, c;
    std::uint16_t object;
  };

  // Least distance between a ray and a segment.
  static double apart(const Vec3& origin, const Vec3& direction, const Vec3& a, const Vec3& b) {
    const Vec3 ab = b - a, across = direction.cross(ab);
    const double cross2 = across.squared_norm();
    double share = 0;
    if (cross2 > 1e-12 * ab.squared_norm())
      share = std::clamp((origin - a).cross(direction).dot(across) / cross2, 0.0, 1.0);
    const auto to_ray = [&](double s) {
      const Vec3 rel = a + s * ab - origin;
      return (rel - std::max(0.0, rel.dot(direction)) * direction).norm();
    };
    return std::min({to_ray(share), to_ray(0), to_ray(1)});
  }

  std::vector<Triangle> triangles_;
};

Material lambert(double rho) {
  Material m;
  m.reflectance.model = ReflectanceModel::lambert, m.reflectance.rho = rho;
  return m;
}

SceneObject satellite(const Vec3& position, const Quat& attitude, double scale) {
  static const auto mesh = std::make_shared<const ObjectMesh>(test::read_shape(kSatellite));
  SceneObject object{mesh, position, attitude, scale, {}};
  object.materials.assign(mesh->shape().parts.size(), lambert(0.3));
  return object;
}

Quat upright(const Vec3& position) {
  const EastNorthUp local = local_axes(position);
  return Quat(Mat3(local.north, local.up.cross(local.north), local.up));
}

constexpr ProductSet kAll = kRadiance | kDepth | kRange | kPosition | kNormal | kLit | kSource | kGsd | kObjectId;

class ObjectsOverTerrain : public test::SampleScenery {
 protected:
  // One stands, sunk a little, one flies; seen obliquely under a low Sun.
  static FrameRequest request(double scale, double sun_elevation_deg, double lat = -10.2, double lon = 44.1) {
    FrameRequest r = test::blank_request();
    const double ground = scenery().terrain->height(lat, lon).height_m;
    const Vec3 stands = to_cartesian({lat, lon, ground + 1.2 * scale}),
               flies = to_cartesian({lat + 0.002 * scale / 10, lon, ground + 14 * scale});
    r.objects.push_back(satellite(stands, upright(stands), scale));
    r.objects.push_back(satellite(flies, Quat(0.8, 0.36, -0.48, 0).normalized(), scale));
    const Vec3 eye = to_cartesian({lat - 0.004 * scale / 10, lon + 0.002 * scale / 10, ground + 25 * scale});
    r.camera = test::square_camera(160, 40);
    r.pose = test::looking(eye, (stands + flies) / 2 - eye, local_axes(eye).up);
    r.sun.direction = test::local_sun(lat, lon, 75, sun_elevation_deg);
    r.accuracy.max_error_px = 0;
    r.products = kAll;
    return r;
  }
  // A place with a shadow that is between so and so many metres deep.
  static std::pair<double, double> where_shadow_ends(double elevation_deg, double low_m, double high_m) {
    for (double lat = -10.9; lat < -9.1; lat += 0.02)
      for (double lon = 43.1; lon < 44.9; lon += 0.02) {
        const double ground = scenery().terrain->height(lat, lon).height_m;
        const Vec3 sun = test::local_sun(lat, lon, 75, elevation_deg);
        const auto hits =
            test::cast_rays(*scenery().renderer, std::vector<Ray>{{to_cartesian({lat, lon, ground + low_m}), sun},
                                                                  {to_cartesian({lat, lon, ground + high_m}), sun}});
        if (hits[0].hit && !hits[1].hit) return {lat, lon};
      }
    throw std::logic_error("no such shadow");
  }
};

// Where every pixel's ray and shadow ray ends, within what float may leave open along borders.
TEST_F(ObjectsOverTerrain, PositionsAndShadowsAgreeWithTheReference) {
  const auto [rim_lat, rim_lon] = where_shadow_ends(6, 30, 300);
  int by_terrain = 0;
  for (const FrameRequest& with : {request(10, 14), request(100, 14), request(30, 6, rim_lat, rim_lon)}) {
    const double scale = with.objects[0].scale;
    FrameRequest without = with;
    without.objects.clear();
    const Frame frame = scenery().renderer->render(with), bare = scenery().renderer->render(without);
    const View view(with.camera, with.pose);
    const ObjectJudge judge(with.objects);
    const double border_m = 1e-5 * scale;
    int on_objects = 0, shaded_terrain = 0, shaded_objects = 0, near_borders = 0;
    for (std::size_t i = 0; i < bare.products.range.size(); ++i) {
      const Vec3 look = view.ray(static_cast<double>(i % 160), static_cast<double>(i / 160))->normalized();
      const double terrain = std::isnan(bare.products.range[i]) ? kInfinity : bare.products.range[i];
      const ObjectJudge::Answer seen = judge.look(view.position(), look, 0);
      if (seen.to_border_m < border_m) {
        ++near_borders;
        continue;
      }
      const bool object = seen.distance < terrain;
      ASSERT_EQ(frame.products.object_id[i], object ? seen.object : 65535) << i;
      if (std::isinf(terrain) && !object) continue;
      ASSERT_NEAR(frame.products.range[i], object ? seen.distance : terrain, object ? 1e-6 * scale : 0) << i;
      on_objects += object;
      if (object) {
        EXPECT_EQ(frame.products.source[i], 65535);
        EXPECT_TRUE(std::isnan(frame.products.gsd[i]));
      }
      // Does anything of an object stand in the Sun's way? The surface that the ray leaves doesn't.
      const Vec3 point = at3(frame.products.position, i), normal = at3(frame.products.normal, i);
      if (normal.dot(with.sun.direction) <= 1e-3) continue;
      const ObjectJudge::Answer toward_sun = judge.look(point, with.sun.direction, object ? 1e-4 * scale : 0);
      const bool blocked = std::isfinite(toward_sun.distance);
      if (!object) {
        if (toward_sun.to_border_m < 1e-4 * scale) continue;
        ASSERT_EQ(frame.products.lit[i], blocked ? 0 : bare.products.lit[i]) << i;
        shaded_terrain += blocked && bare.products.lit[i] > 0;
        continue;
      }
      // Not where the ray leaves next to an edge of its own facet.
      if (toward_sun.to_border_m < 1e-3 * scale) continue;
      const auto ground = test::cast_rays(*scenery().renderer, std::vector<Ray>{{point, with.sun.direction}});
      ASSERT_EQ(frame.products.lit[i], blocked || ground[0].hit ? 0 : 1) << i;
      shaded_objects += blocked, by_terrain += ground[0].hit;
    }
    EXPECT_GT(on_objects, 500);
    EXPECT_GT(shaded_terrain, 40);
    EXPECT_GT(shaded_objects, 50);
    EXPECT_LT(near_borders, 10);
    EXPECT_NEAR(frame.report.object_fraction, (on_objects + near_borders) / 25600.0, near_borders / 25600.0 + 1e-12);
  }
  EXPECT_GT(by_terrain, 30);
}

// In a crater's shadow, or behind the horizon from the Sun, an object is dark as the ground is.
TEST_F(ObjectsOverTerrain, TerrainCastsShadowsOnObjects) {
  FrameRequest r = request(10, 14);
  const Frame day = scenery().renderer->render(r);
  r.sun.direction = test::local_sun(-10.2, 44.1, 75, -4);
  const Frame night = scenery().renderer->render(r);
  double day_sum = 0, night_sum = 0;
  for (std::size_t i = 0; i < day.products.lit.size(); ++i)
    if (day.products.object_id[i] < 2)
      day_sum += static_cast<double>(day.products.lit[i]), night_sum += static_cast<double>(night.products.lit[i]);
  EXPECT_GT(day_sum, 300);
  EXPECT_EQ(night_sum, 0);
}

// By more than `share` of the first.
std::size_t differing(const std::vector<float>& a, const std::vector<float>& b, float share = 0) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    count += !(std::abs(a[i] - b[i]) <= share * std::abs(a[i]) || (std::isnan(a[i]) && std::isnan(b[i])));
  return count;
}

// As without objects: points agree to the bit, shadow flags but for edges.
TEST_F(ObjectsOverTerrain, AreTheSameByZBufferAndByRays) {
  for (const double radius_deg : {0.0, 0.2666})
    for (const int samples : {1, 4})
      for (const bool lens : {false, true}) {
        FrameRequest r = request(30, 9);
        r.sun.angular_radius_deg = radius_deg;
        r.accuracy.samples_per_pixel = samples;
        if (lens) r.camera.distortion = {-0.2, 0.03, 0, 1e-3, -1e-3};
        r.band.emplace(10.0, 1.0);
        r.temperature_k = 200;
        r.objects[0].materials[0].temperature_k = 320;  // what is without the Sun differs, too
        r.visibility = Visibility::zbuffer;
        const FrameProducts drawn = scenery().renderer->render(r).products;
        r.visibility = Visibility::raytrace;
        const FrameProducts traced = scenery().renderer->render(r).products;
        EXPECT_EQ(drawn.object_id, traced.object_id);
        EXPECT_EQ(drawn.source, traced.source);
        EXPECT_EQ(differing(drawn.normal, traced.normal), 0U);
        for (std::size_t i = 0; i < drawn.range.size(); ++i) {
          if (!std::isnan(drawn.range[i])) {
            ASSERT_EQ(drawn.range[i], traced.range[i]);
          }
        }
        // Of the disc one knows horizons, the other asks 256 directions. Samples drawn at once are added in another
        // order.
        const float share = radius_deg > 0 ? 0.05F : samples > 1 ? 1e-6F : 0;
        const std::size_t few = radius_deg > 0 ? 25600 / 200 : 25600 / 2000;
        EXPECT_LE(differing(drawn.lit, traced.lit, share), few);
        EXPECT_LE(differing(drawn.radiance, traced.radiance, share), static_cast<std::size_t>(samples) * few);
      }
}

TEST_F(ObjectsOverTerrain, SameBytesWithAnyNumberOfThreads) {
  for (const Visibility visibility : {Visibility::zbuffer, Visibility::raytrace}) {
    FrameRequest r = request(20, 12);
    r.visibility = visibility;
    const Frame one = Renderer(scenery().terrain, {1, std::size_t{256} << 20}).render(r),
                three = Renderer(scenery().terrain, {3, std::size_t{256} << 20}).render(r);
    EXPECT_EQ(one.products.radiance, three.products.radiance);
    EXPECT_EQ(one.products.object_id, three.products.object_id);
  }
}

// A plate of 10 m x 10 m faces a telescope 2 million kilometres away, 38 million times its half: what float would do to
// it is told by its range, in closed form, and by its outline.
TEST_F(ObjectsOverTerrain, AccurateFarAway) {
  FrameRequest r;
  r.terrain = false;
  const Vec3 eye(3.1e8, -1.2e8, 4.3e7), toward = Vec3(0.6, 0.3, -0.7).normalized();
  const double distance = 2e9;
  ObjectShape shape;
  for (const auto& [x, y] : {std::pair{-5.F, -5.F}, {5.F, -5.F}, {5.F, 5.F}, {-5.F, 5.F}})
    shape.corners.push_back({{x, y, 0}, Vec3f::zero()});
  shape.triangles = {{{0, 1, 2}, 0}, {{0, 2, 3}, 0}};
  shape.parts = {"plate"};
  const auto mesh = std::make_shared<const ObjectMesh>(shape);
  r.pose = test::looking(eye, toward, Vec3::unit_z());
  // The plate's axes along the image's.
  const Quat moon_from_camera = r.pose.camera_from_moon.conjugate();
  const Vec3 axis = moon_from_camera * Vec3::unit_z();
  r.objects.push_back({mesh, eye + distance * axis, moon_from_camera, 1, {lambert(0.5)}});
  const double f = 32.3 * distance / 10;  // 32.3 pixels across
  r.camera = {64, 64, f, f, 31.5, 31.5, {}};
  r.sun.direction = -axis;
  r.products = kRange | kObjectId | kLit | kRadiance;
  const Frame frame = scenery().renderer->render(r);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x) {
      const auto i = static_cast<std::size_t>(y * 64 + x);
      const bool inside = std::max(std::abs(x - 31.5), std::abs(y - 31.5)) < 32.3 / 2;
      ASSERT_EQ(frame.products.object_id[i], inside ? 0 : 65535) << x << " " << y;
      if (!inside) continue;
      ASSERT_NEAR(frame.products.range[i], distance, 2e-6);  // eight steps of a double of that size
      ASSERT_EQ(frame.products.lit[i], 1);
      ASSERT_NEAR(frame.products.radiance[i], 1361 * 0.5 / M_PI, 1e-4);
    }
}

// A file whose coordinates begin far from the object: float has less of them for it, its rays and shadows don't.
TEST_F(ObjectsOverTerrain, VerticesFarFromTheMeshOrigin) {
  ObjectShape shape = test::read_shape(kSatellite);
  // What is left of the corners there: the same shape at both places.
  const Vec3f away(4096, -2048, 1024);
  for (ObjectCorner& corner : shape.corners) corner.place += away;
  ObjectShape near = shape;
  for (ObjectCorner& corner : near.corners) corner.place -= away;
  FrameRequest r = request(10, 14);
  r.objects.resize(1);
  SceneObject& object = r.objects[0];
  object.mesh = std::make_shared<const ObjectMesh>(near);
  const FrameProducts here = scenery().renderer->render(r).products;
  object.mesh = std::make_shared<const ObjectMesh>(shape);
  object.position_m -= object.moon_from_object * Vec3(object.scale * away.cast<double>());
  const FrameProducts there = scenery().renderer->render(r).products;
  EXPECT_EQ(here.object_id, there.object_id);
  EXPECT_EQ(differing(here.lit, there.lit), 0U);
  for (std::size_t i = 0; i < here.range.size(); ++i) {
    if (!std::isnan(here.range[i])) {
      ASSERT_NEAR(here.range[i], there.range[i], 1e-6);
    }
  }
}

// A corner that a damaged file puts 1e10 m away: what else there is of the object stays, to the last bit of its range.
TEST_F(ObjectsOverTerrain, DistantVertexHidesNothing) {
  FrameRequest r = request(10, 14);
  r.objects.resize(1);
  const FrameProducts whole = scenery().renderer->render(r).products;
  ObjectShape shape = r.objects[0].mesh->shape();
  for (const float away : {1e10F, 3000.F}) {
    ObjectShape stray = shape;
    const auto corner = static_cast<std::uint32_t>(stray.corners.size());
    stray.corners.push_back({{0, 0, -away}, {0, 0, 0}});
    stray.triangles.push_back({{0, 1, corner}, 0});
    const auto mesh = std::make_shared<const ObjectMesh>(stray);
    EXPECT_EQ(mesh->notes().size(), away > 1e9F ? 1U : 0U);
    r.objects[0].mesh = mesh;
    const FrameProducts with = scenery().renderer->render(r).products;
    std::size_t same = 0, all = 0;
    for (std::size_t i = 0; i < whole.range.size(); ++i) {
      if (whole.object_id[i] != 0) continue;
      ++all;
      same += with.object_id[i] == 0 && std::abs(with.range[i] - whole.range[i]) < 1e-6 && with.lit[i] == whole.lit[i];
    }
    // The near one is a spike down into the ground, which hides and shades something.
    EXPECT_GE(same, away > 1e9F ? all : all * 9 / 10) << away;
  }
}

// Round the clock: a sheet's both sides are surface, and neither shines through.
TEST_F(ObjectsOverTerrain, SheetsHaveTwoSides) {
  ObjectShape shape;
  for (const auto& [x, y] : {std::pair{-5.F, -5.F}, {5.F, -5.F}, {5.F, 5.F}, {-5.F, 5.F}})
    shape.corners.push_back({{x, y, 0}, {0, 0, 1}});
  shape.triangles = {{{0, 1, 2}, 0}, {{0, 2, 3}, 0}};
  shape.parts = {"plate"};
  FrameRequest r;
  r.terrain = false;
  r.objects.push_back({std::make_shared<const ObjectMesh>(shape), Vec3::zero(), Quat::identity(), 1, {lambert(1)}});
  r.camera = test::square_camera(9, 30);
  r.products = kRadiance | kNormal | kAngles;
  for (const double eye : {-1.0, 1.0})
    for (const double sun : {-1.0, 1.0}) {
      r.pose = test::looking(Vec3(0, 0, 100 * eye), Vec3(0, 0, -eye), Vec3::unit_y());
      r.sun.direction = Vec3(0, 0.6, 0.8 * sun);
      const FrameProducts p = scenery().renderer->render(r).products;
      EXPECT_NEAR(p.radiance[40], eye == sun ? 1361 * 0.8 / M_PI : 0, 1e-4);
      EXPECT_NEAR(p.normal[3 * 40 + 2], eye, 1e-7);
    }
}

// SENSOR++ figure 4: a specular panel that turns is bright where the halfway vector meets its normal, by equation (11).
TEST_F(ObjectsOverTerrain, GlintFollowsThePanel) {
  ObjectShape shape;
  for (const auto& [x, y] : {std::pair{-5.F, -5.F}, {5.F, -5.F}, {5.F, 5.F}, {-5.F, 5.F}})
    shape.corners.push_back({{x, y, 0}, Vec3f::zero()});
  shape.triangles = {{{0, 1, 2}, 0}, {{0, 2, 3}, 0}};
  shape.parts = {"panel"};
  const double rho = 0.4, p = 300, phase = 40 * test::kDegree;
  Material panel;
  panel.reflectance.model = ReflectanceModel::blinn_phong;
  panel.reflectance.rho = rho, panel.reflectance.shininess = p;
  FrameRequest r;
  r.terrain = false;
  r.objects.push_back({std::make_shared<const ObjectMesh>(shape), Vec3::zero(), Quat::identity(), 1, {panel}});
  r.camera = {1, 1, 1000, 1000, 0, 0, {}};
  r.pose = test::looking(Vec3(0, 0, 100), -Vec3::unit_z(), Vec3::unit_y());
  r.sun.direction = Vec3(std::sin(phase), 0, std::cos(phase));
  r.products = kRadiance;
  double brightest = 0, faintest = kInfinity;
  for (int turn_deg = -40; turn_deg <= 80; ++turn_deg) {
    const double turn = turn_deg * test::kDegree;
    r.objects[0].moon_from_object = AngleAxis(turn, Vec3::unit_y());
    const auto radiance = static_cast<double>(scenery().renderer->render(r).products.radiance[0]);
    const double mu0 = std::cos(phase - turn);
    const double expected = mu0 <= 0 ? 0
                                     : 1361 * mu0 * rho / (8 * M_PI) * (p + 4) * (p + 2) / (p + std::exp2(-p / 2)) *
                                           std::pow(std::cos(turn - phase / 2), p);  // eq. (11)
    EXPECT_NEAR(radiance, expected, 1e-5 * expected + 1e-30) << turn_deg;
    brightest = std::max(brightest, radiance), faintest = std::min(faintest, radiance);
    if (turn_deg == 20) {
      EXPECT_EQ(radiance, brightest);
    }
  }
  EXPECT_GT(brightest, 1e12 * faintest) << "what an EXR must hold";
}

}  // namespace
}  // namespace selenograph::engine
