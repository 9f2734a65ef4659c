// One frame with ground truth.   one_frame [URL [TOKEN]]
#include <exception>
#include <iostream>
#include <selenograph_client.hpp>

int main(int argc, char** argv) try {
  selenograph::Client client(argc > 1 ? argv[1] : "http://127.0.0.1:8080", argc > 2 ? argv[2] : "");

  const selenograph::Frame frame =
      client.frame({{"camera", {{"width", 320}, {"height", 240}, {"fov_deg", 50}}},
                    {"pose", selenograph::pose::nadir(selenograph::pose::geodetic(-6.5, 40.0, 30000.0))},
                    {"sun", {{"subsolar", {{"lat_deg", 0.0}, {"lon_deg", 100.0}}}}},
                    {"products", {"radiance", "range", "geodetic", "lit"}}});

  for (const auto& [name, array] : frame.products) {
    std::cout << name << ": " << array.height() << " x " << array.width() << " x " << array.channels() << " "
              << array.type() << "\n";
  }
  const std::size_t row = 120, column = 160;
  std::cout.precision(17);
  std::cout << "radiance " << frame["radiance"].at(row, column) << " W m-2 sr-1\n"
            << "range " << frame["range"].at(row, column) << " m\n"
            << "latitude " << frame["geodetic"].at(row, column, 0) << " deg\n"
            << "level of detail error " << frame.meta.value("lod_error_m", 0.0) << " m\n"
            << "etag " << frame.etag << "\n";
  for (const auto& [stage, ms] : frame.timing_ms) std::cerr << stage << " " << ms << " ms\n";
  return 0;
} catch (const selenograph::Refused& refused) {
  std::cerr << "refused: " << refused.what() << "\n";
  return 2;
} catch (const std::exception& e) {
  std::cerr << e.what() << "\n";
  return 1;
}
