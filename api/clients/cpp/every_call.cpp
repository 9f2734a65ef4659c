// Makes the calls that no example makes and prints their results as JSON, for ../tests/clients_test.py.
#include <iostream>
#include <selenograph_client.hpp>

namespace {

using namespace selenograph;

// Returns a number as JSON, NaN as null.
Json number(double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); }

Json numbers(const Vector3& v) { return {number(v[0]), number(v[1]), number(v[2])}; }

// Returns one attitude in all forms that the client offers.
std::map<std::string, Json> poses() {
  const Json position = pose::cartesian({1800000, 0, 0});
  const Quaternion wxyz = Quaternion::wxyz(0.8, 0.2, -0.4, 0.4);
  const Quaternion matrix = Quaternion::matrix({{{0.36, -0.8, -0.48}, {0.48, 0.6, -0.64}, {0.8, 0, 0.6}}});
  return {{"camera_from_moon_wxyz", pose::camera_from_moon(position, wxyz)},
          {"camera_from_moon_xyzw", pose::camera_from_moon(position, Quaternion::xyzw(0.2, -0.4, 0.4, 0.8))},
          {"moon_from_camera_wxyz", pose::moon_from_camera(position, Quaternion::wxyz(0.8, -0.2, 0.4, -0.4))},
          {"moon_from_camera_xyzw", pose::moon_from_camera(position, Quaternion::xyzw(-0.2, 0.4, -0.4, 0.8))},
          {"camera_from_moon_matrix", pose::camera_from_moon(position, matrix)},
          {"moon_from_camera_matrix", pose::moon_from_camera(position, matrix.inverse())},
          {"camera_from_moon_mrp", pose::camera_from_moon(position, Quaternion::mrp({-1.0 / 9, 2.0 / 9, -2.0 / 9}))}};
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) throw Error("usage: every_call URL");
  Client client(argv[1]);
  const Json sun{{"subsolar", {{"lat_deg", 0.0}, {"lon_deg", 100.0}}}};
  const Json camera{{"width", 320}, {"height", 240}, {"fov_deg", 50}};
  Json results;

  for (const Height& h : client.heights({{-6.5, 40.0}, {30.0, 100.0}})) {
    results["heights"].push_back({{"height_m", number(h.height_m)},
                                  {"post_spacing_m", number(h.post_spacing_m)},
                                  {"source", h.source},
                                  {"filled", h.filled},
                                  {"blended", h.blended}});
  }
  const Json above = pose::nadir(pose::geodetic(-6.5, 40.0, 30000.0));
  for (const Landmark& p : client.project(camera, above, {{-6.5, 40.0}, {-6.6, 40.1, 500.0}, {30.0, 100.0}}, sun)) {
    results["project"].push_back({{"x_px", number(p.x_px)},
                                  {"y_px", number(p.y_px)},
                                  {"range_m", number(p.range_m)},
                                  {"height_m", number(p.height_m)},
                                  {"in_frame", p.in_frame},
                                  {"visible", p.visible},
                                  {"lit", number(p.lit)}});
  }
  for (const RayHit& h :
       client.rays({{{1345000, 1130000, -200000}, {-1345, -1130, 199}}, {{1800000, 0, 0}, {1, 0, 0}}}, sun)) {
    results["rays"].push_back({{"hit", h.hit},
                               {"range_m", number(h.range_m)},
                               {"position_m", numbers(h.position_m)},
                               {"normal", numbers(h.normal)},
                               {"lit", number(h.lit)}});
  }
  results["datasets"] = client.datasets().at("datasets").size();
  for (const auto& [form, pose] : poses()) {
    const Frame frame = client.frame(
        {{"camera", {{"width", 4}, {"height", 4}, {"fov_deg", 50}}}, {"pose", pose}, {"products", {"source"}}});
    results["attitudes"][form] = frame.meta.at("request").at("pose").at("camera_from_moon");
  }
  const Answer picture = client.post(
      "/v1/frames", {{"camera", camera}, {"pose", above}, {"sun", sun}, {"products", {"image"}}}, "image/png");
  results["picture"] = {{"type", picture.header("content-type")}, {"bytes", picture.body.size()}};
  const Json bounds{{"south_deg", -7.0}, {"north_deg", -6.0}, {"west_deg", 39.5}, {"east_deg", 40.5}};
  try {
    const Frame map = client.map({{"map", {{"projection", "equirectangular"}, {"bounds", bounds}, {"gsd_m", 500.0}}},
                                  {"sun", sun},
                                  {"products", {"radiance", "height"}}});
    results["map"] = {
        {"shape", map["height"].shape}, {"height", map["height"].at(3, 5)}, {"hash", map.meta.at("content_hash")}};
  } catch (const Refused& refused) {
    results["map"] = {{"status", refused.status}};
  }
  std::cout << results << "\n";
  return 0;
} catch (const std::exception& e) {
  std::cerr << e.what() << "\n";
  return 1;
}
