// `selenograph verify ground`: compares slopes and craters of a detail's ground with the laws that it follows.
#include <fmt/format.h>

#include <filesystem>

#include "api/answers/ground_report.h"
#include "dem/base/parallel.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/start.h"

namespace selenograph::server {

namespace fs = std::filesystem;

int verify_ground(const VerifyGroundSettings& settings) {
  const auto detail = detail_of(settings.detail, settings.terrain);
  const fs::path folder = settings.output;
  fs::create_directories(folder);
  api::GroundReport report{settings.detail, {}, {}, {}, {}, {}};
  where_loops_run([&] {
    report.slopes = engine::ground_slopes(detail->preset(), settings.places);
    report.craters = engine::ground_craters(detail->preset());
    report.albedo = engine::ground_albedo(detail->preset(), settings.places);
    report.rocks = engine::ground_rocks(detail->preset());
    report.roughness = engine::ground_roughness(detail->preset(), settings.places);
  });
  write_whole((folder / "slopes.csv").string(), api::slopes_csv(report));
  write_whole((folder / "craters.csv").string(), api::craters_csv(report));
  if (!report.albedo.empty()) write_whole((folder / "albedo.csv").string(), api::albedo_csv(report));
  if (!report.rocks.empty()) write_whole((folder / "rocks.csv").string(), api::rocks_csv(report));
  fmt::print("{}", api::ground_markdown(report));
  const std::vector<std::string> violations = api::bound_violations(report);
  for (const std::string& what : violations) fmt::print("beyond its bound: {}\n", what);
  fmt::print("{0}: tables as CSV; picture: deploy/plot {0}\n", settings.output);
  return violations.empty() ? 0 : 1;
}

}  // namespace selenograph::server
