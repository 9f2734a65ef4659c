// `selenograph features`: a detail's craters or rocks in a region, as POST /v1/features answers them, and in a frame.
#include <fmt/format.h>

#include <filesystem>
#include <stdexcept>

#include "api/answers/coco.h"
#include "api/message/json_text.h"
#include "api/message/problem.h"
#include "api/requests/features_json.h"
#include "api/requests/frame_json.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/request_file.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;
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

// A file to be written once both lists are complete.
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

// Throws RequestError for a frame that can have no craters and rocks.
void refuse_without_features(const api::FrameQuery& query) {
  const auto refuse = [](const std::string& pointer, const std::string& why) {
    throw api::RequestError("invalid_request", "the frame has no craters and no rocks", {{pointer, why}});
  };
  if (!query.request.detail) refuse("/detail", "is required: it has the craters and rocks");
  if (!query.request.terrain) refuse("/terrain", "must not be false: craters and rocks are on the terrain");
}

// Returns the COCO document of the craters and rocks in a frame.
OutputFile list_frame(const Json& request, const FeaturesSettings& s, const engine::Renderer& renderer,
                      const api::Assets& assets, const api::Limits& limits) {
  api::FrameQuery query = api::read_frame(request, limits, assets, {}, ground_heights(renderer));
  refuse_without_features(query);
  // The COCO document describes these limits as its request's, so they must be set before it is made.
  if (!query.request.craters) query.request.craters = s.rims;
  const std::string image = !s.image.empty() ? s.image : fs::path(s.frame).stem().string() + ".png";
  // Render only the pixels of rocks, all of them: labels need no other product.
  engine::FrameRequest listing = query.request;
  listing.products = engine::kRock;
  listing.truth.reset();
  const engine::Frame frame = renderer.render(listing);
  const api::FrameLabels labels(frame, query.request.camera, query.request.craters->least_px);
  std::string message =
      fmt::format("{}: {} craters and {} rocks in {}\n", s.coco, labels.craters(), labels.rocks(), image);
  if (const std::size_t cut_off = frame.report.craters.cut_off; cut_off > 0)
    message += fmt::format("{}: {} more omitted: the camera cannot image all of their rim\n", s.coco, cut_off);
  return {s.coco, api::json_line(labels.coco(query, image)), message};
}

// Checks both files before any work: neither must be written if the other cannot be.
void check_outputs(const FeaturesSettings& s, bool has_region, bool has_frame) {
  if (has_region && has_frame && is_same_file(s.output, s.coco))
    throw std::runtime_error("-o and --coco: " + s.coco + " cannot be both");
  if (has_region && s.output != "-") check_can_be_written(s.output);
  if (has_frame && s.coco != "-") check_can_be_written(s.coco);
}

}  // namespace

int features(const FeaturesSettings& settings) {
  set_up_log(settings.terrain.log_level);
  const std::string region = region_request(settings);
  const std::string frame = settings.frame.empty() ? "" : read_request(settings.frame);
  if (region.empty() && frame.empty()) throw std::runtime_error("REQUEST.json, --region or --coco is required");
  check_outputs(settings, !region.empty(), !frame.empty());
  const api::Assets assets(settings.terrain.assets_dir, mesh_options(settings.terrain));
  const api::Limits limits = command_limits();
  const auto renderer = make_renderer(settings.terrain);
  std::vector<OutputFile> files;
  const api::Response answer = api::answer_or_problem({}, [&] {
    const auto json = [&](const std::string& text) { return api::parse_json(text); };
    if (!region.empty()) files.push_back(list_region(json(region), settings, *renderer, assets, limits));
    if (!frame.empty()) files.push_back(list_frame(json(frame), settings, *renderer, assets, limits));
    return api::Response{};
  });
  if (answer.status != 200) {
    print_problem(answer);
    return 1;
  }
  for (const OutputFile& file : files) {
    if (file.path == "-") {
      fmt::print("{}", file.text);
    } else {
      write_whole(file.path, file.text);
      fmt::print(stream_for_messages(file.path), "{}", file.message);
    }
  }
  return 0;
}

}  // namespace selenograph::server
