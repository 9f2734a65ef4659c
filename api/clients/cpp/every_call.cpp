// Calls every endpoint and prints the answers as JSON, for ../tests/every_call_test.py, which writes REQUESTS: requests
// by path.
#include <fstream>
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

// Returns these arrays of an answer as flat lists, whole numbers of 64 bits as text.
Json lists(const Frame& answer, const std::vector<std::string>& names) {
  Json lists = Json::object();
  for (const std::string& name : names) {
    Json& list = lists[name] = Json::array();
    const auto append = [&](const auto& values) {
      for (const auto value : values) {
        if constexpr (sizeof(value) == 8 && std::is_integral_v<std::decay_t<decltype(value)>>)
          list.push_back(std::to_string(value));
        else
          list.push_back(number(value));
      }
    };
    std::visit(append, answer[name].data);
  }
  return lists;
}

// Makes the calls whose requests are in the test's file.
Json calls_by_path(Client& client, const Json& requests) {
  Json results;
  const Answer array = client.post("/v1/frames", requests.at("/v1/frames"), "application/x-npy");
  const Json in_header = Json::parse(array.header("selenograph-meta"));
  results["/v1/frames"] = Json::parse(client.get(in_header.at("metadata_at")).body);
  results["/v1/lidar"] =
      lists(client.lidar(requests.at("/v1/lidar")), {"range_m", "direction", "count", "false_alarm", "rock"});
  results["/v1/limb"] = lists(client.limb(requests.at("/v1/limb")), {"x_px", "position_m", "terminator_visible"});
  results["/v1/horizons"] = lists(client.horizons(requests.at("/v1/horizons")), {"elevation_deg", "azimuth_deg"});
  results["/v1/illumination"] = lists(client.illumination(requests.at("/v1/illumination")), {"sun_mean", "sun"});
  results["/v1/sky"] = client.sky(requests.at("/v1/sky"));
  results["/v1/features"] = client.features(requests.at("/v1/features"));
  for (const char* path : {"/v1/verify/roundtrip", "/v1/verify/mertis"}) {
    results[path] = client.post(path, requests.at(path));
  }
  for (const char* path : {"/v1/height?lat_deg=-6.5&lon_deg=40", "/openapi.json"}) {
    results[path] = Json::parse(client.get(path).body);
  }
  return results;
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 3) throw Error("usage: every_call URL REQUESTS");
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
  results["by_path"] = calls_by_path(client, Json::parse(std::ifstream(argv[2])));
  std::cout << results << "\n";
  return 0;
} catch (const std::exception& e) {
  std::cerr << e.what() << "\n";
  return 1;
}
