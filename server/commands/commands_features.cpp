// `selenograph features`: a detail's craters or rocks in a region, as POST /v1/features answers them.
#include <fmt/format.h>

#include <stdexcept>

#include "api/message/json_text.h"
#include "api/message/problem.h"
#include "api/requests/features_json.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/request_file.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

using api::Json;

// Returns a region's request as text; empty if neither a file nor an option gives one.
std::string region_request(const FeaturesSettings& s) {
  const bool has_options = !s.detail.empty() || !s.region.empty() || s.smallest_m;
  if (!s.request.empty() && has_options)
    throw std::runtime_error("give either REQUEST.json or --detail, --region and --smallest-m");
  if (!s.request.empty()) return read_request(s.request);
  if (!has_options) return {};
  if (s.detail.empty() || s.region.empty()) throw std::runtime_error("--detail and --region require each other");
  Json request{
      {"detail", s.detail},
      {"region",
       {{"south_deg", s.region[0]}, {"north_deg", s.region[1]}, {"west_deg", s.region[2]}, {"east_deg", s.region[3]}}}};
  if (s.smallest_m) request["smallest_m"] = *s.smallest_m;
  request["min_depth_over_diameter"] = s.rims.least_depth;
  return api::json_text(request);
}

// A file to be written once the list is complete.
struct OutputFile {
  std::string path, text;
  std::string message;  // printed after writing
};

// Returns the CSV of a region's craters or rocks.
OutputFile list_region(const Json& request, const FeaturesSettings& s, const engine::Renderer& renderer,
                       const api::Assets& assets, const api::Limits& limits) {
  const api::FeaturesQuery query = api::read_features(request, limits, assets);
  const api::FeatureList list(query, renderer);
  return {
      s.output, list.csv(),
      fmt::format("{}: {} {}\n", s.output, list.size(), query.kind == api::FeatureKind::rocks ? "rocks" : "craters")};
}

}  // namespace

int features(const FeaturesSettings& settings) {
  set_up_log(settings.terrain.log_level);
  const std::string region = region_request(settings);
  if (region.empty()) throw std::runtime_error("REQUEST.json or --region is required");
  if (settings.output != "-") check_can_be_written(settings.output);
  const api::Assets assets(settings.terrain.assets_dir, mesh_options(settings.terrain));
  const api::Limits limits = command_limits();
  const auto renderer = make_renderer(settings.terrain);
  OutputFile file;
  const api::Response answer = api::answer_or_problem({}, [&] {
    file = list_region(api::parse_json(region), settings, *renderer, assets, limits);
    return api::Response{};
  });
  if (answer.status != 200) {
    print_problem(answer);
    return 1;
  }
  if (file.path == "-") {
    fmt::print("{}", file.text);
  } else {
    write_whole(file.path, file.text);
    fmt::print(stream_for_messages(file.path), "{}", file.message);
  }
  return 0;
}

}  // namespace selenograph::server
