// A descent of 20 frames towards a landing site, two in flight, in order.   descent [URL [TOKEN]]
#include <cmath>
#include <exception>
#include <iostream>
#include <selenograph_client.hpp>

int main(int argc, char** argv) try {
  selenograph::Client client(argc > 1 ? argv[1] : "http://127.0.0.1:8080", argc > 2 ? argv[2] : "");

  const selenograph::Place site{-6.5, 40.0};
  const int steps = 20;
  int step = 0;
  const auto next = [&]() -> std::optional<selenograph::Json> {
    if (step == steps) return std::nullopt;
    // The path leads half a degree north, from 30 km to 2 km.
    const double remaining_share = 1 - double(step++) / steps;
    const auto position =
        selenograph::pose::geodetic(site.lat_deg - 0.5 * remaining_share, site.lon_deg, 2000 + 28000 * remaining_share);
    return selenograph::Json{{"camera", {{"width", 160}, {"height", 120}, {"fov_deg", 60}}},
                             {"pose", selenograph::pose::look_at(position, site)},
                             {"sun", {{"subsolar", {{"lat_deg", 0.0}, {"lon_deg", 100.0}}}}},
                             {"products", {"radiance", "range"}}};
  };
  std::cout.precision(17);
  client.frames(next, [&](std::size_t index, const selenograph::Frame& frame) {
    // Ranges of pixels that see no ground are NaN, which fmin() ignores.
    double nearest_m = INFINITY;
    for (const double range_m : frame["range"].as<double>()) nearest_m = std::fmin(nearest_m, range_m);
    std::cout << "frame " << index << ": nearest ground " << nearest_m << " m, etag " << frame.etag << "\n";
  });
  return 0;
} catch (const selenograph::Refused& refused) {
  std::cerr << "refused: " << refused.what() << "\n";
  return 2;
} catch (const std::exception& e) {
  std::cerr << e.what() << "\n";
  return 1;
}
