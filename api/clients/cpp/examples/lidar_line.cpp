// A lidar's ranges along a ground track at a height of 15 km.   lidar_line [URL [TOKEN]]
#include <cmath>
#include <exception>
#include <iostream>
#include <selenograph_client.hpp>

int main(int argc, char** argv) try {
  selenograph::Client client(argc > 1 ? argv[1] : "http://127.0.0.1:8080", argc > 2 ? argv[2] : "");

  const double degree_rad = std::acos(-1.0) / 180, radius_m = 1737400 + 15000, lon_rad = 40.0 * degree_rad;
  std::vector<selenograph::Ray> rays;
  for (int i = 0; i < 50; ++i) {
    const double lat_rad = (-7.0 + 0.02 * i) * degree_rad;
    const selenograph::Vector3 up{std::cos(lat_rad) * std::cos(lon_rad), std::cos(lat_rad) * std::sin(lon_rad),
                                  std::sin(lat_rad)};
    // Each ray looks straight down from its place on the track.
    rays.push_back({{radius_m * up[0], radius_m * up[1], radius_m * up[2]}, {-up[0], -up[1], -up[2]}});
  }
  std::cout.precision(17);
  int index = 0;
  for (const selenograph::RayHit& hit : client.rays(rays)) {
    std::cout << "shot " << index++ << ": ";
    if (hit.hit) {
      std::cout << "range " << hit.range_m << " m\n";
    } else {
      std::cout << "no echo\n";
    }
  }
  return 0;
} catch (const selenograph::Refused& refused) {
  std::cerr << "refused: " << refused.what() << "\n";
  return 2;
} catch (const std::exception& e) {
  std::cerr << e.what() << "\n";
  return 1;
}
