#include "api/requests/frame_json.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "api/answers/points_answer.h"
#include "api/requests/points_json.h"
#include "tests/support/meshes.h"
#include "tests/support/vec_text.h"

namespace selenograph::api {
namespace {

constexpr double kRadians = std::numbers::pi / 180;

Json minimal() {
  return Json::parse(R"({
    "camera": {"width": 1024, "height": 512, "fov_deg": 90},
    "pose": {"geodetic": {"lat_deg": 26, "lon_deg": 3, "height_m": 20000}, "nadir": {}},
    "sun": {"direction": [0, 1, 0.2]}
  })");
}

// The minimal request with `patch` merged in (RFC 7396: null takes a member away).
Json patched(const std::string& patch) {
  Json body = minimal();
  body.merge_patch(Json::parse(patch));
  return body;
}

engine::FrameRequest accepted(const std::string& patch) { return read_frame(patched(patch), Limits{}).request; }

// The pointers of the findings, "" when accepted; details on request.
std::string refused(const std::string& patch, std::string* details = nullptr) {
  try {
    read_frame(patched(patch), Limits{});
  } catch (const RequestError& e) {
    EXPECT_EQ(e.code(), "invalid_request");
    std::string pointers;
    for (const Finding& f : e.findings()) {
      pointers += (pointers.empty() ? "" : " ") + f.pointer;
      if (details) *details += f.detail + "\n";
    }
    return pointers;
  }
  return "accepted";
}

// Where a MOON_ME point falls in the image: the pinhole equation, written down independently of the engine.
Vec2 pixel_of(const engine::FrameRequest& request, const Vec3& point_m) {
  const Vec3 p = request.pose.camera_from_moon * (point_m - request.pose.position_m);
  EXPECT_GT(p.z(), 0);
  const engine::Camera& c = request.camera;
  return {c.fx * p.x() / p.z() + c.cx, c.fy * p.y() / p.z() + c.cy};
}

void expect_same_attitude(const Quat& a, const Quat& b) {
  EXPECT_LT(a.angle_to(b), 1e-7);
  EXPECT_LT((a.matrix() - b.matrix()).norm(), 1e-14);
}

TEST(CameraJson, FieldOfViewIsTheHorizontalFullAngle) {
  const engine::Camera camera = accepted("{}").camera;
  EXPECT_NEAR(camera.fx, 512, 1e-12);  // 90 degrees: half the width
  EXPECT_EQ(camera.fy, camera.fx);
  EXPECT_EQ(camera.cx, 511.5);
  EXPECT_EQ(camera.cy, 255.5);
}

TEST(CameraJson, IntrinsicsAndTheirDefaults) {
  const engine::Camera camera = accepted(R"({"camera": {"fov_deg": null, "fx": 800}})").camera;
  EXPECT_EQ(camera.fy, 800);
  EXPECT_EQ(camera.cx, 511.5);
  const auto full = accepted(R"({"camera": {"fov_deg": null, "fx": 800, "fy": 801, "cx": 1.5, "cy": -2,
                                 "distortion": {"model": "brown_conrady", "k1": 0.1, "p2": -0.01}}})")
                        .camera;
  EXPECT_EQ(full.cy, -2);
  EXPECT_EQ(full.distortion.k1, 0.1);
  EXPECT_EQ(full.distortion.p2, -0.01);
}

TEST(CameraJson, FocalLengthAndPixelPitch) {
  const char* const request = R"({"camera": {"fov_deg": null, "focal_length_mm": 35, "pixel_pitch_um": 5.5}})";
  const engine::Camera camera = accepted(request).camera;
  EXPECT_NEAR(camera.fx, 35000 / 5.5, 1e-9);
  EXPECT_EQ(camera.fy, camera.fx);
  EXPECT_EQ(camera.cx, 511.5);
  EXPECT_EQ(camera.cy, 255.5);
  const auto resolved = resolved_json(read_frame(patched(request), Limits()))["camera"];
  EXPECT_EQ(resolved["fx"], camera.fx);
  EXPECT_FALSE(resolved.contains("focal_length_mm") || resolved.contains("pixel_pitch_um"));
  // Equidistant: the radius of an angle is the focal length times the angle.
  EXPECT_NEAR(accepted(R"({"camera": {"model": "fisheye", "fov_deg": null, "focal_length_mm": 1.4,
                                      "pixel_pitch_um": 2}})")
                  .camera.fx,
              700, 1e-9);
  std::string details;
  EXPECT_EQ(refused(R"({"camera": {"focal_length_mm": 35, "pixel_pitch_um": 5.5}})", &details),
            "/camera/focal_length_mm");
  EXPECT_NE(details.find("\"fov_deg\" and \"focal_length_mm\""), std::string::npos) << details;
  EXPECT_EQ(refused(R"({"camera": {"fov_deg": null, "fx": 9, "focal_length_mm": 35, "pixel_pitch_um": 5.5}})"),
            "/camera/focal_length_mm");
  EXPECT_EQ(refused(R"({"camera": {"fov_deg": null, "cx": 9, "focal_length_mm": 35, "pixel_pitch_um": 5.5}})"),
            "/camera/cx");
  EXPECT_EQ(refused(R"({"camera": {"fov_deg": null, "focal_length_mm": 35}})", &details), "/camera/pixel_pitch_um");
  EXPECT_NE(details.find("\"focal_length_mm\""), std::string::npos) << details;
  EXPECT_EQ(refused(R"({"camera": {"pixel_pitch_um": 5.5}})"), "/camera/focal_length_mm");
  EXPECT_EQ(refused(R"({"camera": {"fov_deg": null, "focal_length_mm": 0, "pixel_pitch_um": 5.5}})"),
            "/camera/focal_length_mm");
  EXPECT_EQ(refused(R"({"camera": {"fov_deg": null, "focal_length_mm": 1e6, "pixel_pitch_um": 1e-6}})"),
            "/camera/focal_length_mm");
}

TEST(CameraJson, Fisheye) {
  const engine::Camera equidistant = accepted(R"({"camera": {"model": "fisheye", "fov_deg": 270}})").camera;
  EXPECT_EQ(equidistant.model, engine::CameraModel::fisheye);
  EXPECT_NEAR(equidistant.fx, 512 / (0.75 * std::numbers::pi), 1e-12);
  const char* const request = R"({"camera": {"model": "fisheye", "fov_deg": 120, "distortion":
      {"model": "kannala_brandt", "k1": 0.1, "k2": 0.01, "k3": -0.001, "k4": 0.0001}}})";
  const engine::Camera lens = accepted(request).camera;
  const double theta = std::numbers::pi / 3, t = theta * theta;
  EXPECT_NEAR(lens.fx, 512 / (theta * (1 + t * (0.1 + t * (0.01 + t * (-0.001 + t * 0.0001))))), 1e-11);
  const auto resolved = resolved_json(read_frame(patched(request), Limits()));
  EXPECT_EQ(resolved["camera"]["distortion"].dump(),
            R"({"model":"kannala_brandt","k1":0.1,"k2":0.01,"k3":-0.001,"k4":0.0001})");
  EXPECT_EQ(read_frame(parse_json(resolved.dump(), 16), Limits()).request.camera, lens);
}

TEST(CameraJson, OpenCvsTerms) {
  const char* const request = R"({"camera": {"fov_deg": 60, "distortion": {"model": "opencv", "k1": 0.5, "k2": 0.2,
      "k3": 0.1, "k4": 0.6, "k5": 0.05, "k6": 0.01, "p1": 0.001, "p2": 0.002, "s1": 0.003, "s2": 0.004, "s3": 0.005,
      "s4": 0.006, "tau_x_deg": 1.1, "tau_y_deg": -2.3}}})";
  const engine::Distortion expected{0.5,  0.2,   0.1,   0.001, 0.002, 0.6, 0.05,
                                    0.01, 0.003, 0.004, 0.005, 0.006, 1.1, -2.3};
  EXPECT_EQ(accepted(request).camera.distortion, expected);
  const auto resolved = resolved_json(read_frame(patched(request), Limits()));
  EXPECT_EQ(read_frame(parse_json(resolved.dump(), 16), Limits()).request.camera.distortion, expected);
  EXPECT_EQ(resolved["camera"]["distortion"]["tau_y_deg"], -2.3);
  // Without them it is Brown's lens, under its name.
  const auto brown = resolved_json(
      read_frame(patched(R"({"camera": {"distortion": {"model": "opencv", "k1": 0.1}}})"), Limits()))["camera"];
  EXPECT_EQ(brown["distortion"].dump(), R"({"model":"brown_conrady","k1":0.1,"k2":0.0,"k3":0.0,"p1":0.0,"p2":0.0})");
}

TEST(CameraJson, CahvorsVectors) {
  const char* const request = R"({"camera": {"fov_deg": null, "cahvor": {"A": [0, 0.6, 0.8], "H": [900, 306, 408],
      "V": [0, 1026.4, -119.8], "O": [0.6, 0, 0.8], "R": [0.1, 0.2, 0.3], "linearity": 0.5}}})";
  const engine::Camera camera = accepted(request).camera;
  ASSERT_TRUE(camera.cahvor);
  EXPECT_EQ(camera.cahvor->o, Vec3(0.6, 0, 0.8));
  EXPECT_EQ(camera.cahvor->r, Vec3(0.1, 0.2, 0.3));
  EXPECT_EQ(camera.cahvor->linearity, 0.5);
  EXPECT_NEAR(camera.fx, 900, 1e-9);  // H = 900 x + 510 A, V = 893 (0, 0.8, -0.6) + 520 A
  EXPECT_NEAR(camera.cx, 510, 1e-9);
  EXPECT_NEAR(camera.fy, 893, 1e-9);
  EXPECT_NEAR(camera.cy, 520, 1e-9);
  const auto resolved = resolved_json(read_frame(patched(request), Limits()));
  EXPECT_EQ(read_frame(parse_json(resolved.dump(), 16), Limits()).request.camera, camera);
  // Vectors of a pinhole are that pinhole, and O is A by default.
  const engine::Camera pinhole =
      accepted(R"({"camera": {"fov_deg": null, "cahvor": {"A": [0, 0, 1], "H": [900, 0, 510], "V": [0, 893, 520]}}})")
          .camera;
  EXPECT_EQ(pinhole, (engine::Camera{pinhole.width, pinhole.height, 900, 893, 510, 520, {}}));
}

TEST(CameraJson, CahvorRefusals) {
  const auto refused_with = [](const std::string& changes) {
    Json cahvor = Json::parse(R"({"A": [0, 0, 1], "H": [900, 0, 510], "V": [0, 893, 520]})");
    cahvor.merge_patch(Json::parse(changes));
    return refused(Json{{"camera", {{"fov_deg", nullptr}, {"cahvor", cahvor}}}}.dump());
  };
  EXPECT_EQ(refused_with(R"({"A": [0, 0, 1.01]})"), "/camera/cahvor/A");
  EXPECT_EQ(refused_with(R"({"A": [1, 0, 0]})"), "/camera/cahvor/A") << "of a frame with x ahead";
  EXPECT_EQ(refused_with(R"({"O": [0, 0.9, 0.435889894]})"), "/camera/cahvor/O");
  EXPECT_EQ(refused_with(R"({"O": [0.7, 0, 0.7141], "A": [-0.7, 0, 0.7141]})"), "/camera/cahvor/O");
  EXPECT_EQ(refused_with(R"({"R": [-1, 0, 0]})"), "/camera/cahvor/R");
  EXPECT_EQ(refused_with(R"({"H": [0, 0, 510]})"), "/camera/cahvor/H");
  EXPECT_EQ(refused_with(R"({"V": [0, -893, 520]})"), "/camera/cahvor/V") << "upside down";
  EXPECT_EQ(refused_with(R"({"V": [893, 0, 520]})"), "/camera/cahvor/V") << "on a line with H";
  EXPECT_EQ(refused_with(R"({"linearity": 1.1})"), "/camera/cahvor/linearity");
  EXPECT_EQ(refused_with(R"({"E": [0, 0, 0]})"), "/camera/cahvor/E");
  EXPECT_EQ(refused_with(R"({"V": null})"), "/camera/cahvor/V");
  const char* const vectors = R"("cahvor": {"A": [0, 0, 1], "H": [900, 0, 510], "V": [0, 893, 520]})";
  EXPECT_EQ(refused(fmt::format(R"({{"camera": {{{}}}}})", vectors)), "/camera/cahvor");
  EXPECT_EQ(refused(fmt::format(R"({{"camera": {{"fov_deg": null, "model": "fisheye", {}}}}})", vectors)),
            "/camera/cahvor");
  EXPECT_EQ(refused(fmt::format(R"({{"camera": {{"fov_deg": null, "distortion": {{}}, {}}}}})", vectors)),
            "/camera/distortion");
}

TEST(CameraJson, Refusals) {
  std::string details;
  EXPECT_EQ(refused(R"({"camera": {"fx": 800}})", &details), "/camera/fx");
  EXPECT_NE(details.find("\"fov_deg\" and \"fx\""), std::string::npos) << details;
  EXPECT_EQ(refused(R"({"camera": {"cy": 1}})"), "/camera/cy");
  EXPECT_EQ(refused(R"({"camera": {"fov_deg": null}})"), "/camera");
  EXPECT_EQ(refused(R"({"camera": {"width": 8192, "height": 8192}})"), "/camera");
  EXPECT_EQ(refused(R"({"camera": {"model": "fisheye", "fov_deg": 359}})"), "/camera/fov_deg");
  EXPECT_EQ(refused(R"({"camera": {"model": "fisheye", "distortion": {"k1": 1}}})"), "/camera/distortion");
  EXPECT_EQ(refused(R"({"camera": {"distortion": {"model": "kannala_brandt"}}})"), "/camera/distortion");
  EXPECT_EQ(refused(R"({"camera": {"model": "fisheye", "distortion": {"model": "kannala_brandt", "p1": 1}}})"),
            "/camera/distortion/p1");
  // The slope 1 + 3 k1 theta^2 is 0 at 74 degrees.
  EXPECT_EQ(refused(R"({"camera": {"model": "fisheye", "fov_deg": 150,
                                   "distortion": {"model": "kannala_brandt", "k1": -0.2}}})"),
            "/camera/fov_deg");
  EXPECT_EQ(refused(R"({"camera": {"model": "fisheye"}, "visibility": "zbuffer"})"), "/visibility");
  EXPECT_EQ(refused(R"({"camera": {"distortion": {"k4": 1}}})"), "/camera/distortion/k4");
}

TEST(PoseJson, NadirWithAzimuthZeroHasNorthUpAndEastRight) {
  for (const double lat : {-60.0, 0.0, 26.0, 89.0}) {
    const auto request = accepted(R"({"pose": {"geodetic": {"lat_deg": )" + std::to_string(lat) + "}}}");
    const Vec3 below = to_cartesian({lat, 3, 0}), north = to_cartesian({lat + 0.01, 3, 0}),
               east = to_cartesian({lat, 3.01, 0});
    EXPECT_NEAR(pixel_of(request, below).x(), 511.5, 1e-6);
    EXPECT_NEAR(pixel_of(request, below).y(), 255.5, 1e-6);
    EXPECT_NEAR(pixel_of(request, north).x(), 511.5, 1e-6) << lat;
    EXPECT_LT(pixel_of(request, north).y(), 250) << lat;
    EXPECT_GT(pixel_of(request, east).x(), 511.6) << lat;
  }
}

TEST(PoseJson, NadirUpAzimuthIsClockwiseFromNorth) {
  const auto request = accepted(R"({"pose": {"nadir": {"up_azimuth_deg": 90}}})");
  const Vec2 east = pixel_of(request, to_cartesian({26, 3.01, 0}));
  EXPECT_LT(east.y(), 250);  // east is up
  EXPECT_NEAR(east.x(), 511.5, 0.1);
}

TEST(PoseJson, TiltLeavesTheNadirTowardAnAzimuth) {
  for (const double tilt_deg : {0.0, 1e-9, 30.0, 90.0, 120.0, 180.0})
    for (const double azimuth_deg : {0.0, 70.0, 250.0}) {
      const auto request = accepted(
          fmt::format(R"({{"pose": {{"nadir": {{"tilt_deg": {}, "up_azimuth_deg": {}}}}}}})", tilt_deg, azimuth_deg));
      const EastNorthUp local = local_axes(26, 3);
      const double azimuth = azimuth_deg * kRadiansPerDegree, tilt = tilt_deg * kRadiansPerDegree;
      const Vec3 level = std::cos(azimuth) * local.north + std::sin(azimuth) * local.east;
      const Mat3 camera_from_moon = request.pose.camera_from_moon.matrix();
      // Boresight and image's up direction, both in the vertical plane of the azimuth.
      EXPECT_LT((camera_from_moon.row(2) - (std::sin(tilt) * level - std::cos(tilt) * local.up)).norm(), 1e-12);
      EXPECT_LT((-camera_from_moon.row(1) - (std::cos(tilt) * level + std::sin(tilt) * local.up)).norm(), 1e-12);
    }
  // Tilted sideways, the image's up direction stays level.
  const auto sideways = accepted(R"({"pose": {"nadir": {"up_azimuth_deg": 0, "azimuth_deg": 90, "tilt_deg": 50}}})");
  const Vec3 up = -sideways.pose.camera_from_moon.matrix().row(1);
  EXPECT_LT((up - local_axes(26, 3).north).norm(), 1e-12);
  EXPECT_EQ(refused(R"({"pose": {"nadir": {"azimuth_deg": 90}}})"), "/pose/nadir/tilt_deg");
  EXPECT_EQ(refused(R"({"pose": {"nadir": {"tilt_deg": 181}}})"), "/pose/nadir/tilt_deg");
}

TEST(PoseJson, HeightsAboveTheGroundAreAddedToIt) {
  const GroundHeights ground = [](const auto&, double lat_deg, double lon_deg) {
    return lat_deg > 80 ? std::nan("") : 100 * lat_deg + lon_deg;
  };
  const auto read = [&](const std::string& patch) {
    return resolved_json(read_frame(patched(patch), Limits(), Assets(), {}, ground)).dump();
  };
  EXPECT_EQ(read(R"({"pose": {"geodetic": {"height_m": null, "height_above_ground_m": 50}}})"),
            read(R"({"pose": {"geodetic": {"height_m": 2653}}})"));
  EXPECT_EQ(read(R"({"pose": {"nadir": null, "look_at": {"lat_deg": 27, "lon_deg": 4, "height_above_ground_m": -1}}})"),
            read(R"({"pose": {"nadir": null, "look_at": {"lat_deg": 27, "lon_deg": 4, "height_m": 2703}}})"));
  const auto refused_at = [&](const std::string& patch, const GroundHeights& heights) {
    try {
      read_frame(patched(patch), Limits(), Assets(), {}, heights);
    } catch (const RequestError& e) {
      return e.findings().front().pointer;
    }
    return std::string();
  };
  const std::string above = R"({"pose": {"geodetic": {"height_m": null, "height_above_ground_m": 50}}})";
  const std::string void_place =
      R"({"pose": {"geodetic": {"height_m": null, "height_above_ground_m": 50, "lat_deg": 85}}})";
  EXPECT_EQ(refused_at(above, {}), "/pose/geodetic/height_above_ground_m") << "without terrain";
  EXPECT_EQ(refused_at(void_place, ground), "/pose/geodetic/height_above_ground_m") << "without data";
  EXPECT_EQ(refused_at(R"({"pose": {"geodetic": {"height_above_ground_m": 50}}})", ground),
            "/pose/geodetic/height_above_ground_m")
      << "both heights";
}

TEST(PoseJson, LookAtPutsItsTargetAtThePrincipalPoint) {
  const auto request = accepted(R"({"camera": {"fov_deg": null, "fx": 900, "cx": 400, "cy": 100},
    "pose": {"nadir": null, "look_at": {"lat_deg": 26.3, "lon_deg": 3.5, "height_m": -1900}}})");
  const Vec2 target = pixel_of(request, to_cartesian({26.3, 3.5, -1900}));
  EXPECT_NEAR(target.x(), 400, 1e-6);
  EXPECT_NEAR(target.y(), 100, 1e-6);
  EXPECT_LT(pixel_of(request, to_cartesian({26.35, 3.5, -1900})).y(), 100);  // north of it is above it
}

TEST(PoseJson, LookAtStraightDownHasLocalNorthUp) {
  const auto request = accepted(R"({"pose": {"nadir": null, "look_at": {"lat_deg": 26, "lon_deg": 3}}})");
  expect_same_attitude(request.pose.camera_from_moon, accepted("{}").pose.camera_from_moon);
  // At a pole, where the axis is the boresight, longitude 180 is up (as for nadir).
  const std::string pole = R"({"geodetic": {"lat_deg": 90, "lon_deg": 0}, )";
  const auto looking = accepted(R"({"pose": )" + pole + R"("nadir": null, "look_at": {"lat_deg": 90, "lon_deg": 0}}})");
  expect_same_attitude(looking.pose.camera_from_moon,
                       accepted(R"({"pose": )" + pole + R"("nadir": {}}})").pose.camera_from_moon);
  EXPECT_LT(pixel_of(looking, to_cartesian({89.9, 180, 0})).y(), 255);
}

// Straight down, what is north up with, and just beside the pole.
TEST(PoseJson, AtAPoleNorthIsAlongTheLongitudeThatIsGiven) {
  for (const int lat_deg : {-90, 90})
    for (const int lon_deg : {20, 200}) {
      const auto above = [&](const std::string& lat, const std::string& attitude) {
        return accepted(fmt::format(R"({{"pose": {{"geodetic": {{"lat_deg": {}, "lon_deg": {}}}, {}}}}})", lat, lon_deg,
                                    attitude))
            .pose.camera_from_moon;
      };
      const std::string pole = std::to_string(lat_deg), beside = lat_deg > 0 ? "89.999999" : "-89.999999";
      const std::string nadir = R"("nadir": {"up_azimuth_deg": 0})";
      const Quat down = above(pole, nadir);
      EXPECT_LT(down.angle_to(above(beside, nadir)), 2e-8);
      // The image's up (-y) is north.
      EXPECT_LT((down.conjugate() * -Vec3::unit_y() - local_axes(lat_deg, lon_deg).north).norm(), 1e-12);
      expect_same_attitude(
          above(pole, fmt::format(R"("nadir": null, "look_at": {{"lat_deg": {}, "lon_deg": {}}})", lat_deg, lon_deg)),
          down);
    }
}

TEST(PoseJson, LookAtUpVector) {
  // Above the equator at longitude 0, looking down -X with +Y (east) up.
  const auto request = accepted(R"({"pose": {"geodetic": null, "position_m": [1757400, 0, 0], "nadir": null,
                                    "look_at": {"lat_deg": 0, "lon_deg": 0, "up": [0, 1e300, 0]}}})");
  const auto expected = Mat3::from_rows({0, 0, -1}, {0, -1, 0}, {-1, 0, 0});  // right is south, down is west
  EXPECT_LT((request.pose.camera_from_moon.matrix() - expected).norm(), 1e-14);
}

TEST(PoseJson, LookAtRefusals) {
  const std::string down = R"({"pose": {"geodetic": null, "position_m": [1757400, 0, 0], "nadir": null, "look_at": )";
  EXPECT_EQ(refused(down + R"({"lat_deg": 0, "lon_deg": 0, "up": [-3, 0, 0]}}})"), "/pose/look_at/up");
  EXPECT_EQ(refused(down + R"({"lat_deg": 0, "lon_deg": 0, "up": [0, 0, 0]}}})"), "/pose/look_at/up");
  EXPECT_EQ(refused(down + R"({"lat_deg": 0, "lon_deg": 0, "up": "south"}}})"), "/pose/look_at/up");
  EXPECT_EQ(refused(down + R"({"lat_deg": 0, "lon_deg": 0, "height_m": 20000}}})"), "/pose/look_at");
  EXPECT_EQ(refused(down + R"({"lat_deg": 91, "lon_deg": 0}}})"), "/pose/look_at/lat_deg");
  // Due north along the axis from below the equator: north can't be up.
  EXPECT_EQ(refused(R"({"pose": {"geodetic": null, "position_m": [1737400, 0, -50000], "nadir": null,
                        "look_at": {"lat_deg": 0, "lon_deg": 0}}})"),
            "/pose/look_at/up");
}

TEST(PoseJson, QuaternionsAreNamedByTheirDirection) {
  // camera_from_moon of the contract's order of axes: +z of the camera is -X of the Moon, +y is -Z, +x is +Y.
  const Quat q(Mat3::from_rows({0, 1, 0}, {0, 0, -1}, {-1, 0, 0}));
  const auto text = [](const Quat& p) { return Json{{"w", p.w}, {"x", p.x}, {"y", p.y}, {"z", p.z}}.dump(); };
  const std::string start = R"({"pose": {"geodetic": null, "position_m": [1757400, 0, 0], "nadir": null, )";
  const auto given = accepted(start + "\"camera_from_moon\": " + text(q) + "}}").pose.camera_from_moon;
  const auto inverse = accepted(start + "\"moon_from_camera\": " + text(q.conjugate()) + "}}").pose.camera_from_moon;
  const auto nadir = accepted(R"({"pose": {"geodetic": null, "position_m": [1757400, 0, 0]}})").pose.camera_from_moon;
  expect_same_attitude(given, q);
  expect_same_attitude(inverse, q);
  expect_same_attitude(nadir, q);
  // OpenGL's camera of the same view: x as before, y up (+Z of the Moon), z backwards (+X).
  const Quat g(Mat3::from_rows({0, 1, 0}, {0, 0, 1}, {1, 0, 0}));
  const std::string axes = R"(, "axes": "opengl"}})";
  expect_same_attitude(accepted(start + "\"camera_from_moon\": " + text(g) + axes).pose.camera_from_moon, q);
  expect_same_attitude(accepted(start + "\"moon_from_camera\": " + text(g.conjugate()) + axes).pose.camera_from_moon,
                       q);
  // A sign that means nothing changes nothing, to the bit.
  const Quat opposite(-q.w, -q.x, -q.y, -q.z);
  EXPECT_EQ(accepted(start + "\"camera_from_moon\": " + text(opposite) + "}}").pose.camera_from_moon, given);
  const std::string zeros = R"("camera_from_moon": {"w": 0.0, "x": -0.0, "y": -1, "z": -0.0}}})";
  const auto without_sign = accepted(start + zeros).pose.camera_from_moon;
  for (const double c : {without_sign.w, without_sign.x, without_sign.y, without_sign.z})
    EXPECT_FALSE(std::signbit(c)) << without_sign;
}

TEST(PoseJson, ZenithUpLaysTheHorizonLevel) {
  // Toward the east from 26 N: the image's x axis is level, its up rises.
  const auto request = accepted(R"({"pose": {"nadir": null,
                                    "look_at": {"lat_deg": 27, "lon_deg": 9, "up": "zenith"}}})");
  const Vec3 vertical = request.pose.position_m.normalized();
  const Mat3 camera_from_moon = request.pose.camera_from_moon.matrix();
  EXPECT_NEAR(camera_from_moon.row(0).dot(vertical), 0, 1e-15);
  EXPECT_LT(camera_from_moon.row(1).dot(vertical), -0.5);
  std::string details;
  EXPECT_EQ(refused(R"({"pose": {"nadir": null, "look_at": {"lat_deg": 26, "lon_deg": 3, "up": "zenith"}}})", &details),
            "/pose/look_at/up");
  EXPECT_EQ(details, "\"zenith\" is along the boresight: give \"north\" or a vector\n");
}

TEST(PoseJson, MatricesAreEquivalentToQuaternions) {
  const std::string start = R"({"pose": {"nadir": null, )";
  const auto same = [&](const std::string& matrix, const std::string& quaternion) {
    expect_same_attitude(accepted(start + matrix + "}}").pose.camera_from_moon,
                         accepted(start + quaternion + "}}").pose.camera_from_moon);
  };
  // Its rows are the camera's axes: right is +Y, down -Z, the boresight -X.
  const std::string rows = "[[0, 1, 0], [0, 0, -1], [-1, 0, 0]]", columns = "[[0, 0, -1], [1, 0, 0], [0, -1, 0]]";
  const auto expected = Mat3::from_rows({0, 1, 0}, {0, 0, -1}, {-1, 0, 0});
  expect_same_attitude(accepted(start + R"("camera_from_moon_matrix": )" + rows + "}}").pose.camera_from_moon,
                       Quat(expected));
  same(R"("moon_from_camera_matrix": )" + columns, R"("camera_from_moon_matrix": )" + rows);
  same(R"("axes": "opengl", "camera_from_moon_matrix": [[0, 1, 0], [0, 0, 1], [1, 0, 0]])",
       R"("camera_from_moon_matrix": )" + rows);
  same(R"("frame": "MOON_PA_DE421", "geodetic": null, "position_m": [1757400, 0, 0], "camera_from_moon_matrix": )" +
           rows,
       R"("frame": "MOON_PA_DE421", "geodetic": null, "position_m": [1757400, 0, 0], "moon_from_camera_matrix": )" +
           columns);
}

TEST(PoseJson, MatrixRefusals) {
  const auto with = [](const std::string& m) {
    return R"({"pose": {"nadir": null, "camera_from_moon_matrix": )" + m + "}}";
  };
  const auto why = [&](const std::string& m) {
    std::string details;
    EXPECT_EQ(refused(with(m), &details), "/pose/camera_from_moon_matrix") << m;
    return details;
  };
  EXPECT_NE(why("[[1, 0, 0], [0, 1, 0], [0, 0, 1.00001]]").find("not orthonormal"), std::string::npos);
  EXPECT_NE(why("[[1, 0, 0], [0, 1, 0], [0, 0, -1]]").find("reflection"), std::string::npos);
  EXPECT_NE(why("[[1, 0, 0], [0, 1, 0]]").find("3"), std::string::npos);
  EXPECT_EQ(refused(with("[[1, 0, 0], [0, 1, 0], [0, 0]]")), "/pose/camera_from_moon_matrix/2");
  EXPECT_EQ(refused(with("[[1, 0, 0], [0, 1, 0], [0, 0, 1.0000003]]")), "accepted");
  EXPECT_NE(refused(R"({"pose": {"camera_from_moon_matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}})"), "accepted");
}

// At an epoch the Sun's direction in ICRF, turned into MOON_ME, is the ephemeris' own: position and attitude turn
// alike.
TEST(PoseJson, InertialPosesTurnWithTheMoon) {
  const std::string utc = "2026-11-20T06:30:00Z";
  const Mat3 moon_from_icrf = engine::moon_me_from_icrf(utc);
  EXPECT_LT((moon_from_icrf * moon_from_icrf.transpose() - Mat3::identity()).norm(), 1e-14);
  const Vec3 position = moon_from_icrf.transpose() * Vec3(1757400, 0, 0);
  const auto camera_from_moon = Mat3::from_rows({0, 1, 0}, {0, 0, -1}, {-1, 0, 0});
  const Mat3 camera_from_icrf = camera_from_moon * moon_from_icrf;
  Json body = minimal();
  Json rows = Json::array();
  for (int r = 0; r < 3; ++r) rows.push_back({camera_from_icrf(r, 0), camera_from_icrf(r, 1), camera_from_icrf(r, 2)});
  body["pose"] = {
      {"frame", "ICRF"}, {"position_m", {position.x(), position.y(), position.z()}}, {"camera_from_moon_matrix", rows}};
  const auto read = [](const Json& of) { return read_frame(of, Limits{}); };
  const auto expect_there = [&](const engine::Pose& pose) {
    EXPECT_LT((pose.position_m - Vec3(1757400, 0, 0)).norm(), 1e-8);
    expect_same_attitude(pose.camera_from_moon, Quat(camera_from_moon));
  };
  EXPECT_THROW(read(body), RequestError);  // no epoch
  Json own = body;
  own["pose"]["utc"] = utc;
  expect_there(read(own).request.pose);
  own["pose"]["frame"] = "J2000";
  expect_there(read(own).request.pose);
  // The Sun's epoch is the pose's, unless it has its own; of what the client expects next, too.
  Json suns = body;
  suns["sun"] = {{"utc", utc}};
  suns["ahead"] = nlohmann::json::array({body["pose"]});
  expect_there(read(suns).request.pose);
  expect_there(read(suns).ahead.at(0));
  suns["pose"]["utc"] = "2026-11-20T07:30:00Z";
  EXPECT_GT((read(suns).request.pose.position_m - Vec3(1757400, 0, 0)).norm(), 10e3);
  // The Moon turns by 13.2 degrees a day.
  const Mat3 later = engine::moon_me_from_icrf("2026-11-21T06:30:00Z");
  EXPECT_NEAR(AngleAxis(later * moon_from_icrf.transpose()).angle_rad / kRadians, 13.18, 0.1);
  EXPECT_EQ(refused(R"({"pose": {"utc": "2026-11-20T06:30:00Z"}})"), "/pose/utc");
  // The same instant as Ephemeris Time, but for the 2 ms in which TDB and TT differ: 9 mm of the Moon's turning.
  const double et_s = 848428269.184;
  Json own_et = body, suns_et = body;
  own_et["pose"]["et_s"] = et_s;
  EXPECT_LT((read(own_et).request.pose.position_m - Vec3(1757400, 0, 0)).norm(), 0.01);
  suns_et["sun"] = {{"et_s", et_s}};
  EXPECT_LT((read(suns_et).request.pose.position_m - Vec3(1757400, 0, 0)).norm(), 0.01);
  EXPECT_EQ(refused(R"({"pose": {"et_s": 848428269.184}})"), "/pose/et_s");
  EXPECT_EQ(refused(R"({"pose": {"frame": "ICRF", "et_s": 1e12, "geodetic": null, "position_m": [1757400, 0, 0]}})"),
            "/pose/et_s");
  EXPECT_NE(refused(R"({"pose": {"frame": "ICRF", "et_s": 0, "utc": "2026-11-20T06:30:00Z", "geodetic": null,
                                 "position_m": [1757400, 0, 0]}})"),
            "accepted");
  EXPECT_EQ(
      refused(R"({"pose": {"frame": "ICRF", "utc": "yesterday", "geodetic": null, "position_m": [1757400, 0, 0]}})"),
      "/pose/utc");
}

TEST(FrameJson, EchoIsNotPartOfTheResolvedRequest) {
  const auto read = [](const std::string& patch) { return read_frame(patched(patch), Limits{}); };
  const FrameQuery plain = read("{}"), echoing = read(R"({"echo": {"t": 12.5, "camera": "n\u00e4v", "n": [1, null]}})");
  EXPECT_EQ(resolved_json(plain), resolved_json(echoing));
  EXPECT_EQ(plain.echo, "");
  EXPECT_EQ(Json::parse(echoing.echo), Json::parse(R"({"t": 12.5, "camera": "n\u00e4v", "n": [1, null]})"));
  for (const char c : echoing.echo) EXPECT_TRUE(c >= ' ' && c <= '~');
  EXPECT_EQ(refused(R"({"echo": 5})"), "/echo");
  EXPECT_EQ(refused(R"({"echo": {"a": ")" + std::string(1017, 'x') + "\"}}"), "/echo");
  EXPECT_EQ(refused(R"({"echo": {"a": ")" + std::string(1016, 'x') + "\"}}"), "accepted");
}

TEST(PoseJson, AxesAreIgnoredForLookAtAndNadir) {
  expect_same_attitude(accepted(R"({"pose": {"axes": "opengl"}})").pose.camera_from_moon,
                       accepted("{}").pose.camera_from_moon);
}

TEST(PoseJson, QuaternionLength) {
  const auto with = [](const std::string& q) { return R"({"pose": {"nadir": null, "camera_from_moon": )" + q + "}}"; };
  EXPECT_NEAR(accepted(with(R"({"w": 1.0009, "x": 0, "y": 0, "z": 0})")).pose.camera_from_moon.norm(), 1, 1e-15);
  std::string details;
  EXPECT_EQ(refused(with(R"({"w": 0, "x": 0, "y": 0, "z": 0})"), &details), "/pose/camera_from_moon");
  EXPECT_EQ(details, "is zero: not an attitude\n");
  EXPECT_EQ(refused(with(R"({"w": 1.002, "x": 0, "y": 0, "z": 0})")), "/pose/camera_from_moon");
  EXPECT_EQ(refused(with(R"({"w": 1e300, "x": 1e300, "y": 0, "z": 0})")), "/pose/camera_from_moon");
  EXPECT_EQ(refused(with(R"({"w": 1, "x": 0, "y": 0})")), "/pose/camera_from_moon/z");
  EXPECT_EQ(refused(with("[1, 0, 0, 0]")), "/pose/camera_from_moon");
}

TEST(PoseJson, PrincipalAxesMoveThePositionByTheirOffset) {
  const std::string position = R"("geodetic": null, "position_m": [1737400, 0, 0], "nadir": {}}})";
  const Vec3 me = accepted(R"({"pose": {"frame": "MOON_ME", )" + position).pose.position_m;
  EXPECT_EQ(me, Vec3(1737400, 0, 0));
  for (const std::string frame : {"MOON_PA_DE421", "MOON_PA_DE440"}) {
    const Vec3 pa = accepted(R"({"pose": {"frame": ")" + frame + "\", " + position).pose.position_m;
    EXPECT_NEAR(pa.norm(), 1737400, 1e-6);
    EXPECT_GT((pa - me).norm(), 800) << frame;  // about 860 m on the surface
    EXPECT_LT((pa - me).norm(), 950) << frame;
  }
}

TEST(PoseJson, PrincipalAxesTurnAttitudeAndPositionAlike) {
  // The same camera in both frames sees the same: what it has on its boresight stays there.
  const std::string pose = R"("geodetic": null, "position_m": [1757400, 0, 0], "nadir": null,
                              "camera_from_moon": {"w": 0.5, "x": 0.5, "y": -0.5, "z": -0.5}}})";
  const auto me = accepted(R"({"pose": {"frame": "MOON_ME", )" + pose).pose;
  const auto pa = accepted(R"({"pose": {"frame": "MOON_PA_DE421", )" + pose).pose;
  EXPECT_LT((me.camera_from_moon * me.position_m - pa.camera_from_moon * pa.position_m).norm(), 1e-6);
  EXPECT_GT(me.camera_from_moon.angle_to(pa.camera_from_moon), 1e-4);
}

TEST(PoseJson, GeodeticIsRefusedInPrincipalAxes) {
  EXPECT_EQ(refused(R"({"pose": {"frame": "MOON_PA_DE421"}})"), "/pose/geodetic");
}

TEST(PoseJson, AlternativesExcludeEachOther) {
  std::string details;
  EXPECT_EQ(refused(R"({"pose": {"position_m": [1757400, 0, 0]}})", &details), "/pose/geodetic");
  EXPECT_NE(details.find("\"position_m\" and \"geodetic\""), std::string::npos) << details;
  EXPECT_EQ(refused(R"({"pose": {"look_at": {"lat_deg": 0, "lon_deg": 0}}})"), "/pose/nadir");
  EXPECT_EQ(refused(R"({"pose": {"nadir": null}})"), "/pose");
  EXPECT_EQ(refused(R"({"pose": {"geodetic": null}})"), "/pose");
  EXPECT_EQ(refused(R"({"pose": {"frame": "MOON_PA"}})", &details), "/pose/frame");
  EXPECT_NE(details.find("\"MOON_PA_DE421\" or \"MOON_PA_DE440\"? MOON_ME is 860 m away"), std::string::npos)
      << details;
  EXPECT_EQ(details.find("did you mean"), std::string::npos) << details;
  EXPECT_EQ(refused(R"({"pose": {"frame": "IAU_MOON"}})", &details), "/pose/frame");
  EXPECT_NE(details.find("pxform(\"IAU_MOON\", \"MOON_ME\", et)"), std::string::npos) << details;
}

TEST(SunJson, EveryWayGivesTheSameDirection) {
  const Vec3 expected = to_cartesian({10, 40, 0}).normalized();
  const auto direction = [](const std::string& sun) {
    return accepted(R"({"sun": {"direction": null, )" + sun + "}}").sun.direction;
  };
  EXPECT_LT((direction(R"("subsolar": {"lat_deg": 10, "lon_deg": 40})") - expected).norm(), 1e-15);
  const Vec3 local = local_axes(expected).up;
  EXPECT_LT(
      (direction(R"("local": {"lat_deg": 10, "lon_deg": 40, "azimuth_deg": 0, "elevation_deg": 90})") - local).norm(),
      1e-15);
  EXPECT_EQ(direction(R"("subsolar": {"lat_deg": 0, "lon_deg": 360})"), Vec3::unit_x());
}

TEST(SunJson, AtAPoleAzimuthsAreFromTheLongitudeThatIsGiven) {
  const auto subsolar = [](const std::string& lat, const std::string& azimuth) {
    return accepted(R"({"sun": {"direction": null, "local": {"lat_deg": )" + lat +
                    R"(, "lon_deg": 20, "azimuth_deg": )" + azimuth + R"(, "elevation_deg": 0}}})")
        .sun.direction;
  };
  EXPECT_LT((subsolar("90", "0") - to_cartesian({0, -160, 0}).normalized()).norm(), 1e-15);
  EXPECT_LT((subsolar("90", "90") - to_cartesian({0, 110, 0}).normalized()).norm(), 1e-15);
  EXPECT_LT((subsolar("-90", "0") - to_cartesian({0, 20, 0}).normalized()).norm(), 1e-15);
  EXPECT_LT((subsolar("-90", "30") - subsolar("-89.9999999", "30")).norm(), 2e-9);
}

TEST(SunJson, LocalIsAzimuthClockwiseFromNorthAndElevation) {
  const auto direction = [](const std::string& local) {
    return accepted(R"({"sun": {"direction": null, "local": )" + local + "}}").sun.direction;
  };
  // At latitude 0, longitude 0: north +Z, east +Y, up +X.
  EXPECT_LT(
      (direction(R"({"lat_deg": 0, "lon_deg": 0, "azimuth_deg": 0, "elevation_deg": 0})") - Vec3::unit_z()).norm(),
      1e-15);
  EXPECT_LT(
      (direction(R"({"lat_deg": 0, "lon_deg": 0, "azimuth_deg": 90, "elevation_deg": 0})") - Vec3::unit_y()).norm(),
      1e-15);
  const Vec3 low = direction(R"({"lat_deg": 0, "lon_deg": 0, "azimuth_deg": 270, "elevation_deg": 15})");
  EXPECT_LT((low - Vec3(std::sin(15 * kRadians), -std::cos(15 * kRadians), 0)).norm(), 1e-15);
  EXPECT_LT((direction(R"({"lat_deg": 26, "lon_deg": 3, "azimuth_deg": 77, "elevation_deg": 90})") -
             to_cartesian({26, 3, 0}).normalized())
                .norm(),
            1e-15);
}

TEST(SunJson, EpochGivesDirectionAndDistance) {
  const std::string utc = R"({"sun": {"direction": null, "utc": "2026-11-20T00:00:00Z")";
  const engine::SunPosition ephemeris = engine::sun_at("2026-11-20T00:00:00Z");
  const engine::Sun sun = accepted(utc + "}}").sun;
  EXPECT_EQ(sun.direction, ephemeris.direction);
  EXPECT_EQ(sun.distance_au, ephemeris.distance_au);
  EXPECT_EQ(accepted(utc + R"(, "distance_au": 1.5}})").sun.distance_au, 1.5);
  EXPECT_EQ(refused(R"({"sun": {"direction": null, "utc": "yesterday"}})"), "/sun/utc");
  // By the day of the year it is the same Sun; so it is by Ephemeris Time, 69.184 s ahead, which turns by 1e-8 in 2 ms.
  EXPECT_EQ(accepted(R"({"sun": {"direction": null, "utc": "2026-324T00:00:00Z"}})").sun.direction, sun.direction);
  const engine::Sun by_et = accepted(R"({"sun": {"direction": null, "et_s": 848404869.184}})").sun;
  EXPECT_LT((by_et.direction - sun.direction).norm(), 1e-8);
  EXPECT_NEAR(by_et.distance_au, sun.distance_au, 1e-10);
  EXPECT_EQ(by_et.angular_radius_deg, engine::sun_radius_deg(by_et.distance_au));
  EXPECT_EQ(refused(R"({"sun": {"direction": null, "et_s": 1e12}})"), "/sun/et_s");
  EXPECT_NE(refused(R"({"sun": {"direction": null, "et_s": 0, "utc": "2026-11-20T00:00:00Z"}})"), "accepted");
}

TEST(SunJson, Refusals) {
  EXPECT_EQ(refused(R"({"sun": {"subsolar": {"lat_deg": 0, "lon_deg": 0}}})"), "/sun/subsolar");
  EXPECT_EQ(refused(R"({"sun": {"direction": null}})"), "/sun");
}

TEST(SunJson, IsRequiredForProductsThatNeedOneOnly) {
  EXPECT_EQ(refused(R"({"sun": null})"), "/sun");
  EXPECT_EQ(refused(R"({"sun": null, "products": ["range", "lit"]})"), "/sun");
  EXPECT_FALSE(
      read_frame(patched(R"({"sun": null, "products": ["range", "depth", "position", "geodetic", "normal", "gsd",
                                      "source"]})"),
                 Limits{})
          .sun_given);
}

TEST(FrameJson, SamplesAreSquaresAndProductsKnown) {
  for (const char* n : {"2", "0", "1.5", "289"}) {
    EXPECT_EQ(refused(R"({"accuracy": {"samples_per_pixel": )" + std::string(n) + "}}"), "/accuracy/samples_per_pixel")
        << n;
  }
  EXPECT_EQ(refused(R"({"products": ["range", "range"]})"), "/products/1");
  EXPECT_EQ(refused(R"({"products": ["range", "Depth"]})"), "/products/1");
}

// The Moon's own: echoed as it was asked for; Sato's parameters as the reflectance that they are in the band.
TEST(FrameJson, SurfacePresets) {
  const auto moon = accepted(R"({"surface": {"preset": "moon-highlands"}})");
  EXPECT_EQ(moon.reflectance.model, engine::ReflectanceModel::moon);
  EXPECT_EQ(moon.reflectance.ground, engine::MoonGround::highlands);
  const auto sato =
      accepted(R"({"surface": {"preset": "sato2014-mare"}, "band": {"center_um": 0.643, "width_um": 0.1}})");
  EXPECT_EQ(sato.reflectance.model, engine::ReflectanceModel::hapke);
  EXPECT_NEAR(sato.reflectance.hapke.w, 0.2545, 1e-9);
  EXPECT_EQ(refused(R"({"surface": {"preset": "moon", "reflectance": {"model": "lambert"}}})"), "/surface/reflectance");
  EXPECT_EQ(refused(R"({"surface": {"preset": "mars"}})"), "/surface/preset");
  EXPECT_EQ(refused(R"({"surface": {"preset": "moon", "temperature_k": 300}})"), "/surface/temperature_k");
  EXPECT_EQ(refused(R"({"surface": {"reflectance": {"model": "moon"}}})"), "/surface/reflectance/model");
}

// A model that would reflect more than arrives, or less than nothing, is refused at the member that makes it so.
TEST(FrameJson, ReflectancesAreThoseOfNature) {
  const auto refused_in = [](const std::string& json) {
    return refused(R"({"surface": {"reflectance": )" + json + "}}");
  };
  const std::string at = "/surface/reflectance/";
  EXPECT_EQ(refused_in(R"({"model": "lunar_lambert", "rho": 0.3})"), at + "rho");  // would reflect more than arrives
  EXPECT_EQ(refused_in(R"({"model": "hapke", "b": 0.9, "c": 2})"), at + "c");      // p(g) < 0 somewhere
  EXPECT_EQ(refused(R"({"surface": {"temperature_k": 300, "reflectance": {"model": "hapke"}}})"),
            "/surface/temperature_k");
}

TEST(FrameJson, BandsAndTemperatures) {
  const auto box = accepted(R"({"band": {"center_um": 0.65, "width_um": 0.1}, "surface": {"temperature_k": 350}})");
  ASSERT_TRUE(box.band);
  EXPECT_NEAR(box.band->center_um(), 0.65, 1e-15);
  EXPECT_EQ(box.temperature_k, 350);
  EXPECT_EQ(accepted(R"({"band": {"response": [[0.5, 0], [0.6, 1], [0.7, 0]]}})").band->response().size(), 3U);
  EXPECT_FALSE(accepted("{}").band);
  EXPECT_EQ(refused(R"({"band": {}})"), "/band");
  EXPECT_EQ(refused(R"({"band": {"center_um": 1, "width_um": 0.1, "response": [[1, 1], [2, 1]]}})"), "/band/response");
  EXPECT_EQ(refused(R"({"band": {"width_um": 0.1, "response": [[1, 1], [2, 1]]}})"), "/band/width_um");
  EXPECT_EQ(refused(R"({"band": {"response": [[2, 1], [1, 1]]}})"), "/band/response");
  EXPECT_EQ(refused(R"({"atmosphere": {"name": "earth"}})"), "/atmosphere /atmosphere/name");
  EXPECT_EQ(refused(R"({"atmosphere": {"name": "../earth"}, "band": {"center_um": 1, "width_um": 0.1}})"),
            "/atmosphere/name");
}

constexpr const char* kSensor = R"({"band": {"center_um": 0.65, "width_um": 0.3}, "products": ["image"], "sensor": {
    "optics": {"f_number": 5.6, "point_spread": {"model": "gaussian", "sigma_px": 0.6}, "vignetting": {"model": "cos4"}},
    "detector": {"pixel_pitch_um": 5.5, "quantum_efficiency": 0.4, "integration_time_s": 0.004, "full_well_e": 13500,
                 "dark_current_e_s": 125, "read_noise_e": 13, "prnu": 0.01, "dsnu_e": 3, "gain_e_dn": 3.3, "offset_dn": 60,
                 "bit_depth": 12, "dead_fraction": 1e-5, "hot_fraction": 1e-4, "hot_current_e_s": 1e5, "smear_time_s": 0,
                 "photon_noise": true}, "seed": 3, "frame": 9007199254740992}})";

TEST(FrameJson, Sensors) {
  const auto request = accepted(kSensor);
  const auto json = resolved_json(read_frame(patched(kSensor), Limits{}));
  EXPECT_EQ(resolved_json(read_frame(Json(json), Limits{})).dump(), json.dump());
  EXPECT_FALSE(json.contains("image"));
  EXPECT_TRUE(request.sensor->motion.none());
  Json moving = Json::parse(kSensor);
  moving["sensor"]["motion"] =
      Json::parse(R"({"angular_rate_deg_s": [0, 1, 0.5], "velocity_m_s": [1, 2, 3], "samples": 5})");
  const auto moved = resolved_json(read_frame(patched(moving.dump()), Limits{}));
  EXPECT_EQ(resolved_json(read_frame(Json(moved), Limits{})).dump(), moved.dump());
  EXPECT_EQ(moved.at("sensor").at("motion").at("samples"), 5);
  EXPECT_EQ(accepted(moving.dump()).sensor->motion.velocity_m_s, Vec3(1, 2, 3));
}

TEST(FrameJson, CameraAndDetectorHaveOnePitch) {
  const auto camera = [](const char* pitch_um) {
    Json patch = Json::parse(kSensor);
    patch["camera"] = {{"fov_deg", nullptr}, {"focal_length_mm", 35}, {"pixel_pitch_um", Json::parse(pitch_um)}};
    return patch.dump();
  };
  EXPECT_NEAR(accepted(camera("5.5")).camera.fx, 35000 / 5.5, 1e-9);
  std::string details;
  EXPECT_EQ(refused(camera("5.6"), &details), "/camera/pixel_pitch_um");
  EXPECT_NE(details.find("sensor.detector.pixel_pitch_um"), std::string::npos) << details;
}

TEST(FrameJson, RefusesSensors) {
  const auto changed = [](const std::string& change) {
    Json patch = Json::parse(kSensor);
    patch.merge_patch(Json::parse(change));
    return refused(patch.dump());
  };
  EXPECT_EQ(changed(R"({"band": null})"), "/sensor");
  EXPECT_EQ(changed(R"({"image": {"bit_depth": 8}})"), "/image");
  EXPECT_EQ(changed(R"({"sensor": {"optics": null}})"), "/sensor/optics");
  EXPECT_EQ(changed(R"({"sensor": {"detector": {"dead_fraction": 0.9, "hot_fraction": 0.2}}})"),
            "/sensor/detector/hot_fraction");
  EXPECT_EQ(changed(R"({"sensor": {"detector": {"offset_dn": 4095}}})"), "/sensor/detector/offset_dn");
  EXPECT_EQ(changed(R"({"sensor": {"optics": {"point_spread": {"sigma_px": null}}}})"),
            "/sensor/optics/point_spread/sigma_px");
  EXPECT_EQ(changed(R"({"sensor": {"optics": {"point_spread": {"model": "airy"}}}})"),
            "/sensor/optics/point_spread/sigma_px");
  const std::string at = "/sensor/optics/point_spread/kernel";
  for (const char* kernel : {"[[1, 2], [3, 4]]", "[[1, 2, 3]]", "[[0]]", "[[1, 1, 1], [1, 1, 1], [1, 1]]"})
    EXPECT_EQ(changed(R"({"sensor": {"optics": {"point_spread": {"model": "kernel", "sigma_px": null, "kernel": )" +
                      std::string(kernel) + "}}}}"),
              at)
        << kernel;
  EXPECT_EQ(changed(R"({"sensor": {"optics": {"vignetting": {"model": "table", "table": [[0, 1], [0, 0.9]]}}}})"),
            "/sensor/optics/vignetting/table");
  EXPECT_EQ(changed(R"({"sensor": {"optics": {"vignetting": {"model": "table"}}}})"),
            "/sensor/optics/vignetting/table");
}

TEST(FrameJson, ReportsEveryFaultAtOnce) {
  EXPECT_EQ(refused(R"({"camera": {"width": -1}, "sun": {"angular_radius_deg": 9}, "products": ["x"]})"),
            "/camera/width /sun/angular_radius_deg /products/0");
}

TEST(FrameJson, TheResolvedRequestGivesTheSameFrame) {
  const Json body = patched(R"({"pose": {"nadir": {"up_azimuth_deg": 33}}, "image": {"full_scale_radiance": 3},
                                "surface": {"reflectance": {"model": "lommel_seeliger"}, "temperature_k": 250},
                                "band": {"response": [[0.41, 0.1], [0.73, 0.9]]}, "products": ["range", "image"],
                                "camera": {"distortion": {"k1": 0.1}}})");
  const FrameQuery once = read_frame(body, Limits{});
  const Json resolved = resolved_json(once);
  const FrameQuery twice = read_frame(resolved, Limits{});
  EXPECT_EQ(twice.request.camera.fx, once.request.camera.fx);
  EXPECT_EQ(twice.request.camera.distortion.k1, 0.1);
  EXPECT_EQ(twice.request.pose.position_m, once.request.pose.position_m);
  EXPECT_EQ(twice.request.pose.camera_from_moon, once.request.pose.camera_from_moon);
  EXPECT_EQ(twice.request.sun.direction, once.request.sun.direction);
  EXPECT_EQ(resolved_json(twice).dump(), resolved_json(once).dump());
  EXPECT_EQ(twice.request.reflectance.model, engine::ReflectanceModel::lommel_seeliger);
  EXPECT_EQ(twice.request.image.full_scale_radiance_w_m2_sr, 3);
  EXPECT_EQ(twice.request.products, once.request.products);
  for (const char* model : {R"({"model": "hapke", "b0": 1.1, "phase_function": "double_henyey_greenstein", "b": 0.2})",
                            R"({"model": "blinn_phong", "shininess": 33})", R"({"model": "lunar_lambert"})",
                            R"({"model": "lunar_lambert", "limb_darkening": 0.4, "phase": "rolo"})",
                            R"({"model": "hapke", "terms": "2002", "bc0": 0.2})"}) {
    const FrameQuery query =
        read_frame(patched(R"({"surface": {"reflectance": )" + std::string(model) + "}}"), Limits{});
    const auto json = resolved_json(query);
    EXPECT_EQ(resolved_json(read_frame(Json(json), Limits{})).dump(), json.dump());
    EXPECT_GT(json.at("surface").at("reflectance").size(), 1U);
  }
}

TEST(PointsJson, RaysAndPlaces) {
  const auto rays =
      read_rays(Json::parse(R"({"rays": [{"origin_m": [1, 2, 3], "direction": [0, 0, -1e300]}]})"), Limits{});
  ASSERT_EQ(rays.rays.size(), 1u);
  EXPECT_EQ(rays.rays[0].direction, -Vec3::unit_z());
  EXPECT_FALSE(rays.sun_given);
  Limits small;
  small.max_rays = 1;
  EXPECT_THROW(
      read_heights(Json::parse(R"({"points": [{"lat_deg": 0, "lon_deg": 0}, {"lat_deg": 0, "lon_deg": 1}]})"), small),
      RequestError);
  EXPECT_THROW(read_rays(Json::parse(R"({"rays": [{"origin_m": [1, 2, 3], "direction": [0, 0, 0]}]})"), Limits{}),
               RequestError);
  EXPECT_EQ(read_height_query({{"lat_deg", "26.5"}, {"lon_deg", "-3"}}).lat_deg, 26.5);
  for (const char* text : {"", "x", "1e999", "nan", "inf", "91", "1 "}) {
    EXPECT_THROW(read_height_query({{"lat_deg", text}, {"lon_deg", "0"}}), RequestError) << text;
  }
  EXPECT_THROW(read_height_query({{"lat_deg", "1"}, {"lon_deg", "0"}, {"height", "0"}}), RequestError);
  try {
    read_height_query({{"lat_deg", "1"}, {"lat_deg", "2"}, {"lon_deg", "0"}});
    ADD_FAILURE() << "a parameter is given twice";
  } catch (const RequestError& e) {
    ASSERT_EQ(e.findings().size(), 1u);
    EXPECT_EQ(e.findings()[0].pointer, "/lat_deg");
  }
}

TEST(PointsJson, NonFiniteNumbersAreNull) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<engine::RayHit> hits{{}, {true, std::nullopt, 5, Vec3(1, 2, 3), Vec3::unit_x(), 0.5}};
  const std::vector<LightOfPoint> unlit(2);
  RaysQuery rays;
  rays.sun_given = true;
  EXPECT_EQ(
      rays_json(hits, unlit, rays).dump(),
      R"({"rays":[{"hit":false},{"hit":true,"range_m":5.0,"position_m":[1.0,2.0,3.0],"normal":[1.0,0.0,0.0],"lit":0.5}]})");
  rays.sun_given = false, rays.objects.resize(1);
  const std::vector<engine::RayHit> on_object{{true, 3, 5, Vec3(1, 2, 3), Vec3::unit_x(), 0}, hits[1]};
  EXPECT_EQ(rays_json(on_object, unlit, rays)["rays"][0]["object"], 3);
  EXPECT_TRUE(rays_json(on_object, unlit, rays)["rays"][1]["object"].is_null());
  const dem::Catalogue nothing{std::vector<dem::RasterInfo>{}};
  EXPECT_EQ(height_answer().write({{10, 190, nan, 0, -1, false}, nothing}).dump(),
            R"({"lat_deg":10.0,"lon_deg":-170.0,"height_m":null,"reason":"no dataset covers this place"})");
  std::vector<engine::Landmark> landmarks{{nan, nan, 100, 5, false, false, 0}};
  landmarks[0].behind_camera = true;
  ProjectQuery query;
  query.points = {{10, 20, 5.0}};
  EXPECT_EQ(
      landmarks_json(landmarks, unlit, query, nothing).dump(),
      R"({"points":[{"x_px":null,"y_px":null,"range_m":100.0,"height_m":5.0,"in_frame":false,"visible":false,"reason":"behind the camera"}]})");
  landmarks[0].behind_camera = false;
  EXPECT_EQ(landmarks_json(landmarks, unlit, query, nothing)["points"][0]["reason"], "beyond the lens's field of view");
  query.shutter.emplace();
  EXPECT_EQ(landmarks_json(landmarks, unlit, query, nothing)["points"][0]["reason"], "seen by no row");
}

// --- row times

const char* const kThroughPoses = R"({"pose": null, "shutter": {"line_time_s": 0.001, "pushbroom": true, "poses": [
    {"time_s": -0.5, "pose": {"position_m": [1757000, -500, 0], "camera_from_moon": {"w": 1, "x": 0, "y": 0, "z": 0}}},
    {"time_s": 0.5, "pose": {"position_m": [1757000, 500, 0], "camera_from_moon": {"w": 1, "x": 0, "y": 0, "z": 0}}},
    {"time_s": 1, "pose": {"geodetic": {"lat_deg": 0, "lon_deg": 0.0326, "height_m": 19600}, "nadir": {}}}]}})";

TEST(ShutterJson, PosesTakeThePlaceOfThePose) {
  const engine::FrameRequest request = accepted(kThroughPoses);
  ASSERT_EQ(request.shutter->poses.size(), 3U);
  EXPECT_EQ(request.shutter->poses[0].time_s, -0.5);
  EXPECT_EQ(request.shutter->poses[1].pose.position_m, Vec3(1757000, 500, 0));
  EXPECT_TRUE(request.shutter->pushbroom);
  EXPECT_LT(std::abs(request.pose.position_m.y()), 100) << "row 0's is between the first two";
}

// In ICRF, of rows of a camera that stands still there: with epochs of their own, or of the Sun's and their times.
Json inertial_rows(bool own_epochs) {
  Json body = patched(R"({"pose": null, "sun": {"direction": null, "utc": "2026-11-20T06:30:00Z"},
                          "shutter": {"line_time_s": 1}})");
  for (const auto& [time_s, utc] : {std::pair(-60.0, "2026-11-20T06:29:00Z"), {600.0, "2026-11-20T06:40:00Z"}}) {
    Json pose{{"frame", "ICRF"},
              {"position_m", {1.5e6, -1e6, 0}},
              {"camera_from_moon", {{"w", 1}, {"x", 0}, {"y", 0}, {"z", 0}}}};
    if (own_epochs) pose["utc"] = utc;
    body["shutter"]["poses"].push_back({{"time_s", time_s}, {"pose", pose}});
  }
  return body;
}

TEST(ShutterJson, TheMoonTurnsBelowInertialPosesWithoutEpochs) {
  const auto poses = [](bool own_epochs) {
    return read_frame(inertial_rows(own_epochs), Limits{}).request.shutter->poses;
  };
  const auto own = poses(true), left_out = poses(false);
  EXPECT_GT((own[0].pose.position_m - own[1].pose.position_m).norm(), 2600) << "4 m/s at this distance";
  for (std::size_t i = 0; i < own.size(); ++i) {
    EXPECT_LT((own[i].pose.position_m - left_out[i].pose.position_m).norm(), 1e-4);
    expect_same_attitude(own[i].pose.camera_from_moon, left_out[i].pose.camera_from_moon);
  }
}

// Between -60 and 600 s rows are exposed from 0 to 511 s.
TEST(ShutterJson, InertialPosesAreLaterThanTheirSky) {
  const auto lag_s = [](Json body, const char* sky) {
    body["sky"] = {{"sun", true}};
    if (sky) body["sky"]["utc"] = sky;
    return read_frame(body, Limits{}).icrf_lag_s;
  };
  for (const bool own : {true, false}) {
    EXPECT_NEAR(lag_s(inertial_rows(own), nullptr), 511, 1e-4);
    EXPECT_NEAR(lag_s(inertial_rows(own), "2026-11-20T06:45:00Z"), -900, 1e-4);
  }
  Json still = inertial_rows(true), moons = patched(R"({"sun": {"direction": null, "utc": "2026-11-20T06:30:00Z"}})");
  still["pose"] = still["shutter"]["poses"][1]["pose"];
  still.erase("shutter");
  EXPECT_NEAR(lag_s(still, nullptr), 600, 1e-4);
  still["pose"].erase("utc");
  EXPECT_EQ(lag_s(still, nullptr), 0);
  EXPECT_EQ(lag_s(moons, "2026-11-20T06:45:00Z"), 0) << "the Moon's frames turn with it";
}

TEST(ShutterJson, ResolvedRequestIsAccepted) {
  EXPECT_FALSE(resolved_json(read_frame(minimal(), Limits())).contains("shutter"));
  for (const std::string patch :
       {R"({"shutter": {"line_time_s": 0.001, "angular_rate_deg_s": [1, 0, 0]}})", kThroughPoses}) {
    const auto resolved = resolved_json(read_frame(patched(patch), Limits()));
    ASSERT_TRUE(resolved.contains("shutter"));
    EXPECT_NE(resolved.contains("pose"), resolved["shutter"].contains("poses"));
    EXPECT_NE(resolved["shutter"].contains("velocity_m_s"), resolved["shutter"].contains("poses"));
    EXPECT_EQ(resolved_json(read_frame(parse_json(resolved.dump(), 16), Limits())).dump(), resolved.dump());
  }
  EXPECT_EQ(resolved_json(read_frame(patched(R"({"shutter": {"line_time_s": 0.5, "angular_rate_deg_s": [1, 0, 0]}})"),
                                     Limits()))["shutter"]
                .dump(),
            R"({"line_time_s":0.5,"angular_rate_deg_s":[1.0,0.0,0.0],"velocity_m_s":[0.0,0.0,0.0],"pushbroom":false})");
}

TEST(ShutterJson, Refusals) {
  const auto shutter = [](const std::string& members) { return R"({"shutter": {)" + members + "}}"; };
  const std::string rate = R"("velocity_m_s": [1, 0, 0])", line = R"("line_time_s": 0.001, )";
  EXPECT_EQ(refused(shutter(line + rate)), "accepted");
  const std::string pose = R"("pose": {"position_m": [1757000, 0, 0], "nadir": {}}})";
  const auto poses = [&](const std::string& from, const std::string& to) {
    return R"("poses": [{"time_s": )" + from + ", " + pose + R"(, {"time_s": )" + to + ", " + pose + "]";
  };
  const auto without_pose = [&](const std::string& members) {
    return R"({"pose": null, "shutter": {)" + members + "}}";
  };
  EXPECT_EQ(refused(without_pose(line + poses("0", "0.511"))), "accepted");
  std::string details;
  EXPECT_EQ(refused(without_pose(line + poses("0", "0.5")), &details), "/shutter/poses");
  EXPECT_NE(details.find("0.511 s"), std::string::npos) << details;
  EXPECT_EQ(refused(without_pose(line + poses("0.1", "0.6"))), "/shutter/poses");
  EXPECT_EQ(refused(without_pose(line + poses("1", "1"))), "/shutter/poses");
  EXPECT_EQ(refused(without_pose(line + R"("poses": [{"time_s": 0, )" + pose + "]")), "/shutter/poses");
  EXPECT_EQ(refused(without_pose(line + R"("poses": [{"time_s": 0}, {"time_s": 1, )" + pose + "]")),
            "/shutter/poses/0/pose");
  EXPECT_EQ(refused(shutter(line + poses("0", "1"))), "/pose");
  EXPECT_EQ(refused(without_pose(line + rate)), "/pose");
  EXPECT_EQ(refused(without_pose(line + rate + ", " + poses("0", "1"))), "/shutter/velocity_m_s");
  EXPECT_EQ(refused(R"({"pose": null})"), "/pose");
  EXPECT_EQ(refused(R"({"visibility": "zbuffer", "shutter": {)" + line + rate + "}}"), "accepted");
  EXPECT_EQ(refused(R"({"visibility": "zbuffer", "shutter": {"pushbroom": true, )" + line + rate + "}}"),
            "/visibility");
  EXPECT_EQ(refused(R"({"pose": null, "ahead": [{"position_m": [1757000, 0, 0], "nadir": {}}], "shutter": {)" + line +
                    poses("0", "1") + "}}"),
            "/ahead");
}

TEST(ShutterJson, RejectsMotionSmearAndSpreadOfASensor) {
  const auto patch = [](const std::string& sensor, bool pushbroom) {
    Json body = Json::parse(R"({"band": {"center_um": 0.6, "width_um": 0.1}, "products": ["image"],
      "shutter": {"line_time_s": 0.001, "velocity_m_s": [1, 0, 0]},
      "sensor": {"optics": {"f_number": 4}, "detector": {"pixel_pitch_um": 5, "quantum_efficiency": 0.5,
                                                         "integration_time_s": 0.001, "gain_e_dn": 10}}})");
    body["shutter"]["pushbroom"] = pushbroom;
    body["sensor"].merge_patch(Json::parse(sensor));
    return body.dump();
  };
  EXPECT_EQ(refused(patch("{}", false)), "accepted");
  EXPECT_EQ(refused(patch("{}", true)), "accepted");
  EXPECT_EQ(refused(patch(R"({"motion": {"velocity_m_s": [1, 0, 0]}})", false)), "/sensor/motion");
  EXPECT_EQ(refused(patch(R"({"detector": {"smear_time_s": 1e-6}})", false)), "/sensor/detector/smear_time_s");
  const char* const spread = R"({"optics": {"point_spread": {"model": "gaussian", "sigma_px": 0.5}}})";
  EXPECT_EQ(refused(patch(spread, false)), "accepted");
  EXPECT_EQ(refused(patch(spread, true)), "/sensor/optics/point_spread");
}

TEST(ShutterJson, LandmarksAcceptAShutter) {
  Json body = minimal();
  body.erase("sun");
  body["points"] = Json::array({{{"lat_deg", 1}, {"lon_deg", 2}}});
  EXPECT_FALSE(read_project(body, Limits()).shutter);
  body["shutter"] = {{"line_time_s", 0.01}, {"velocity_m_s", {1, 2, 3}}};
  ProjectQuery query = read_project(body, Limits());
  EXPECT_EQ(query.shutter->rates.velocity_m_s, Vec3(1, 2, 3));
  body.erase("pose");
  EXPECT_THROW(read_project(body, Limits()), RequestError);
  const double nan = std::nan("");
  const std::vector<engine::Landmark> landmarks{{3, 4, 100, 5, true, true, 0, 0.04},
                                                {nan, nan, nan, 5, false, false, 0, nan}};
  query.points = {{10, 20, 5.0}, {10, 20, 5.0}};
  const std::vector<LightOfPoint> unlit(2);
  const dem::Catalogue nothing{std::vector<dem::RasterInfo>{}};
  EXPECT_EQ(
      landmarks_json(landmarks, unlit, query, nothing).dump(),
      R"({"points":[{"x_px":3.0,"y_px":4.0,"range_m":100.0,"height_m":5.0,"in_frame":true,"visible":true,"time_s":0.04},)"
      R"({"x_px":null,"y_px":null,"range_m":null,"height_m":5.0,"in_frame":false,"visible":false,"time_s":null,"reason":"seen by no row"}]})");
}

// --- objects

FrameQuery with_objects(const std::string& pose) {
  const Assets assets(SELENOGRAPH_SOURCE_DIR "/deploy/assets", test::mesh_options());
  const Json object{{"mesh", "satellite"},
                    {"pose", Json::parse(pose)},
                    {"scale", 3},
                    {"material", {{"reflectance", {{"model", "lambert"}, {"rho", 0.3}}}, {"temperature_k", 280}}},
                    {"part_materials", {{"panel", {{"reflectance", {{"model", "blinn_phong"}}}}}}}};
  Json body = minimal();
  body["objects"] = nlohmann::json::array({object});
  return read_frame(body, Limits{}, assets);
}

TEST(Objects, EveryFormOfAPoseIsEquivalent) {
  const Vec3 place = to_cartesian({26, 3, 500});
  const EastNorthUp local = local_axes(place);
  const engine::SceneObject up =
      with_objects(R"({"geodetic": {"lat_deg": 26, "lon_deg": 3, "height_m": 500}, "upright": {"azimuth_deg": 90}})")
          .request.objects[0];
  EXPECT_LT((up.position_m - place).norm(), 1e-9);
  EXPECT_LT((up.moon_from_object * Vec3::unit_x() - local.east).norm(), 1e-12);
  EXPECT_LT((up.moon_from_object * Vec3::unit_y() - local.north).norm(), 1e-12);
  EXPECT_LT((up.moon_from_object * Vec3::unit_z() - local.up).norm(), 1e-12);

  const char* q = R"({"w": 0.6, "x": 0, "y": 0.8, "z": 0})";
  const auto quaternion = [&](const std::string& name, const std::string& frame) {
    return with_objects(R"({"frame": ")" + frame + R"(", "position_m": [1737400, 5, 6], ")" + name + "\": " + q + "}")
        .request.objects[0];
  };
  const engine::SceneObject forward = quaternion("moon_from_object", "MOON_ME"),
                            back = quaternion("object_from_moon", "MOON_ME"),
                            other = quaternion("moon_from_object", "MOON_PA_DE440");
  expect_same_attitude(forward.moon_from_object, Quat(0.6, 0, 0.8, 0));
  expect_same_attitude(back.moon_from_object, Quat(0.6, 0, -0.8, 0));
  const Mat3 me_from_pa = engine::moon_me_from(engine::BodyFrame::moon_pa_de440);
  EXPECT_LT((other.position_m - me_from_pa * Vec3(1737400, 5, 6)).norm(), 1e-9);
  EXPECT_LT((other.moon_from_object * Vec3::unit_x() - me_from_pa * (forward.moon_from_object * Vec3::unit_x())).norm(),
            1e-12);
}

TEST(Objects, AtAPoleTheyStandAlongTheLongitudeThatIsGiven) {
  const engine::SceneObject object =
      with_objects(R"({"geodetic": {"lat_deg": -90, "lon_deg": 20, "height_m": 0}, "upright": {}})").request.objects[0];
  EXPECT_LT((object.moon_from_object * Vec3::unit_x() - to_cartesian({0, 20, 0}).normalized()).norm(), 1e-12);
}

TEST(Objects, MaterialsAreByPart) {
  const FrameQuery query = with_objects(R"({"position_m": [1737400, 0, 0], "upright": {}})");
  const engine::SceneObject& o = query.request.objects[0];
  EXPECT_EQ(o.scale, 3);
  ASSERT_EQ(o.materials.size(), o.mesh->shape().parts.size());
  for (std::size_t i = 0; i < o.materials.size(); ++i) {
    const bool panel = o.mesh->shape().parts[i] == "panel";
    EXPECT_EQ(o.materials[i].reflectance.model,
              panel ? engine::ReflectanceModel::blinn_phong : engine::ReflectanceModel::lambert);
    EXPECT_EQ(o.materials[i].temperature_k, panel ? 0 : 280);
  }
}

TEST(Objects, ResolvedRequestIsAccepted) {
  const Assets assets(SELENOGRAPH_SOURCE_DIR "/deploy/assets", test::mesh_options());
  const std::string first = resolved_json(with_objects(R"({"frame": "MOON_PA_DE421", "position_m": [1737400, 5, 6],
                                                           "object_from_moon": {"w": -0.6, "x": 0, "y": 0.8, "z": 0}})"))
                                .dump();
  EXPECT_EQ(resolved_json(read_frame(parse_json(first, 16), Limits{}, assets)).dump(), first);
}

}  // namespace
}  // namespace selenograph::api
