// `selenograph verify roundtrip`: extracts a DEM from images of it, and writes the difference as statistics and
// rasters.
#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <vector>

#include "api/answers/round_trip_answer.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/place.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

// A round trip in one mode, its statistics and its time.
struct Verified {
  engine::RoundTripRequest request;
  engine::RoundTrip trip;
  engine::DifferenceStatistics statistics;
  double seconds = 0;
};

// Writes the differences and the extracted heights, which are the original ones plus the differences, as GeoTIFFs.
void write_rasters(const fs::path& folder, const engine::RoundTrip& trip) {
  const dem::GeotiffGrid grid = api::grid_of(trip.window);
  dem::write_geotiff((folder / "difference.tif").string(), grid, trip.difference_m, "extracted - original");
  std::vector<float> extracted = trip.original_m;
  for (std::size_t i = 0; i < extracted.size(); ++i)
    extracted[i] = static_cast<float>(static_cast<double>(extracted[i]) + static_cast<double>(trip.difference_m[i]));
  dem::write_geotiff((folder / "extracted.tif").string(), grid, extracted, "height above 1737.4 km, extracted");
}

// Runs a round trip, and writes its rasters and statistics to the folder of its mode.
Verified verify(const engine::Renderer& renderer, const engine::RoundTripRequest& request, const fs::path& output) {
  const std::string mode(api::mode_name(request.mode));
  ProgressBar bar;
  const auto start = std::chrono::steady_clock::now();
  Verified verified{
      request, engine::round_trip(renderer, request, [&](double share) { bar.show(share, "mode " + mode); }), {}};
  verified.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  verified.statistics = engine::statistics_of(verified.trip);
  const fs::path folder = output / mode;
  fs::create_directories(folder);
  write_rasters(folder, verified.trip);
  write_json((folder / "statistics.json").string(),
             api::round_trip_answer().write({request, verified.trip, verified.statistics}));
  // Free the rasters: the summary needs only statistics.
  verified.trip.original_m = {};
  verified.trip.difference_m = {};
  return verified;
}

template <typename Value>
void print_row(const char* what, const std::vector<Verified>& modes, Value&& value) {
  fmt::print("{:<28}", what);
  for (const Verified& v : modes) fmt::print("{:>16}", value(v));
  fmt::print("\n");
}

// Returns the z of the quadrant whose mean deviates most; NaN if the last quadrant has none.
double largest_z(const Verified& v) {
  double largest = 0;
  for (const engine::Quadrant& q : v.statistics.quadrants)
    if (!(std::abs(q.statistics.z) <= std::abs(largest))) largest = q.statistics.z;
  return largest;
}

void print_summary(const std::vector<Verified>& modes) {
  using api::length_text;
  fmt::print("{}\n", modes.front().trip.window.tile.name);
  print_row("extracted - original", modes, [](const Verified& v) { return api::mode_name(v.request.mode); });
  print_row("posts compared", modes, [](const Verified& v) { return v.trip.compared; });
  print_row("hidden", modes, [](const Verified& v) { return v.trip.hidden; });
  print_row("missed", modes, [](const Verified& v) { return v.trip.missed; });
  print_row("under a finer tile", modes, [](const Verified& v) { return v.trip.elsewhere; });
  print_row("void", modes, [](const Verified& v) { return v.trip.voids; });
  print_row("mean", modes, [](const Verified& v) { return length_text(v.statistics.all.mean_m); });
  print_row("mean of size", modes, [](const Verified& v) { return length_text(v.statistics.all.mean_absolute_m); });
  print_row("median", modes, [](const Verified& v) { return length_text(v.statistics.median_m); });
  print_row("rms", modes, [](const Verified& v) { return length_text(v.statistics.all.rms_m); });
  print_row("99.9 % within", modes,
            [](const Verified& v) { return length_text(v.statistics.absolute_percentiles.back().value_m); });
  print_row("worst", modes, [](const Verified& v) { return length_text(v.statistics.worst_m); });
  print_row("largest z of a quadrant", modes, [](const Verified& v) { return fmt::format("{:.1f}", largest_z(v)); });
  print_row("camera positions", modes, [](const Verified& v) { return v.trip.stations; });
  print_row("seconds", modes, [](const Verified& v) { return fmt::format("{:.1f}", v.seconds); });
}

}  // namespace

int verify_round_trip(const VerifyRoundTripSettings& settings) {
  set_up_log(settings.terrain.log_level);
  engine::RoundTripRequest request = settings.request;
  const Geographic center = place_of(settings.center).value();
  request.lat_deg = center.lat_deg;
  request.lon_deg = center.lon_deg;
  const auto renderer = make_renderer(settings.terrain);
  fs::create_directories(settings.output);
  std::vector<Verified> modes;
  for (const auto& [name, mode] : api::kRoundTripModes) {
    if (settings.mode != "both" && settings.mode != name) continue;
    request.mode = mode;
    modes.push_back(verify(*renderer, request, settings.output));
  }
  print_summary(modes);
  fmt::print("{0}: difference.tif, extracted.tif, statistics.json of each mode; pictures: deploy/plot {0}\n",
             settings.output);
  return 0;
}

}  // namespace selenograph::server
