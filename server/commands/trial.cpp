#include "server/commands/trial.h"

#include <fmt/format.h>

#include <cstdio>

#include "server/http/http_server.h"

namespace selenograph::server {
namespace {

// Prints the result of a check, and returns it.
bool report(const std::string& check, bool is_good, const std::string& detail) {
  fmt::print("{:<6} {}{}{}\n", is_good ? "ok" : "FAILED", check, detail.empty() ? "" : ": ", detail);
  std::fflush(stdout);
  return is_good;
}

// Checks that a path is answered with status 200 and a body.
bool check_get(const std::string& url, const std::string& path) {
  const ClientAnswer answer = http_request(url, "GET", path);
  return report("GET " + path, answer.status == 200 && !answer.body.empty(), fmt::format("status {}", answer.status));
}

// Returns a request for 16 x 16 pixels from 20 km above the middle of the finest DEM file.
std::string small_frame(const dem::Footprint& f) {
  const double lat = (f.south_deg + f.north_deg) / 2, lon = (f.west_deg + f.east_deg) / 2;
  return fmt::format(
      R"({{"camera": {{"model": "pinhole", "width": 16, "height": 16, "fov_deg": 20}},)"
      R"( "pose": {{"geodetic": {{"lat_deg": {0}, "lon_deg": {1}, "height_m": 20000}},)"
      R"( "nadir": {{"up_azimuth_deg": 0}}}},)"
      R"( "sun": {{"local": {{"lat_deg": {0}, "lon_deg": {1}, "azimuth_deg": 90, "elevation_deg": 30}}}},)"
      R"( "products": ["radiance"]}})",
      lat, lon);
}

// Checks that a small frame is answered as .npy of the expected size.
bool check_frame(const std::string& url, const dem::Catalogue& catalogue) {
  const ClientAnswer answer =
      http_request(url, "POST", "/v1/frames", small_frame(catalogue.rasters().back().footprint), "application/x-npy");
  constexpr std::size_t kPixelBytes = 16 * 16 * sizeof(float);
  const bool good =
      answer.status == 200 && answer.body.size() > kPixelBytes && answer.body.compare(0, 6, "\x93NUMPY") == 0;
  return report(
      "POST /v1/frames", good,
      good ? fmt::format("{} bytes", answer.body.size()) : fmt::format("status {} {}", answer.status, answer.body));
}

}  // namespace

bool run_trial(const std::string& url, const dem::Catalogue& catalogue) {
  bool is_good =
      report("catalogue", !catalogue.rasters().empty(), fmt::format("{} DEM files", catalogue.rasters().size()));
  for (const dem::CatalogueProblem& problem : catalogue.problems())
    is_good &= report(problem.path, problem.unrelated, problem.what);
  for (const char* path : {"/health/live", "/health/ready", "/metrics", "/openapi.json", "/v1/datasets"})
    is_good &= check_get(url, path);
  if (!catalogue.rasters().empty()) is_good &= check_frame(url, catalogue);
  return is_good;
}

}  // namespace selenograph::server
