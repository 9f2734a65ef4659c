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

// A region's request as text; empty: neither a file nor an option says one.
std::string region_request(const FeaturesSettings& s) {
  const bool by_options = !s.detail.empty() || !s.region.empty() || s.smallest_m;
  if (!s.request.empty() && by_options)
    throw std::runtime_error("REQUEST.json or --detail, --region and --smallest-m: they say the same");
  if (!s.request.empty()) return read_request(s.request);
  if (!by_options) return {};
  if (s.detail.empty() || s.region.empty()) throw std::runtime_error("--detail and --region are needed, both");
  Json request{
      {"detail", s.detail},
      {"region",
       {{"south_deg", s.region[0]}, {"north_deg", s.region[1]}, {"west_deg", s.region[2]}, {"east_deg", s.region[3]}}}};
  if (s.smallest_m) request["smallest_m"] = *s.smallest_m;
  request["min_depth_over_diameter"] = s.rims.least_depth;
  return api::json_text(request);
}

// What is to be written, and said of it.
struct Written {
  std::string path, text, said;
};

Written of_region(const Json& request, const FeaturesSettings& s, const engine::Renderer& renderer,
                  const api::Assets& assets, const api::Limits& limits) {
  const api::FeaturesQuery query = api::read_features(request, limits, assets);
  const api::FeatureList list(query, renderer);
  return {
      s.output, list.csv(),
      fmt::format("{}: {} {}\n", s.output, list.size(), query.kind == api::FeatureKind::rocks ? "rocks" : "craters")};
}

void refuse_without_features(const api::FrameQuery& query) {
  const auto refuse = [](const std::string& pointer, const std::string& why) {
    throw api::RequestError("invalid_request", "the frame has no craters and no rocks", {{pointer, why}});
  };
  if (!query.request.detail) refuse("/detail", "is required: craters and rocks are its");
  if (!query.request.terrain) refuse("/terrain", "is false: craters are terrain's, and rocks lie on it");
}

Written of_frame(const Json& request, const FeaturesSettings& s, const engine::Renderer& renderer,
                 const api::Assets& assets, const api::Limits& limits) {
  api::FrameQuery query = api::read_frame(request, limits, assets);
  refuse_without_features(query);
  // What counts is what the document says of its request.
  if (!query.request.craters) query.request.craters = s.rims;
  const std::string image = !s.image.empty() ? s.image : fs::path(s.frame).stem().string() + ".png";
  engine::FrameRequest listing = query.request;
  listing.products = engine::kRock, listing.truth.reset();
  const engine::Frame frame = renderer.render(listing);
  const api::FrameLabels labels(frame, query.request.camera, query.request.craters->least_px);
  std::string said =
      fmt::format("{}: {} craters and {} rocks in {}\n", s.coco, labels.craters(), labels.rocks(), image);
  if (const std::size_t cut_off = frame.report.craters.cut_off; cut_off > 0)
    said += fmt::format("{}: {} more are left out: the camera cannot image all of their rim\n", s.coco, cut_off);
  return {s.coco, api::json_line(labels.coco(query, image)), said};
}

// Neither of two files is written if the other can't be.
void check_outputs(const FeaturesSettings& s, bool of_region, bool of_frame) {
  if (of_region && of_frame && is_same_file(s.output, s.coco))
    throw std::runtime_error("-o and --coco: " + s.coco + " cannot be both");
  if (of_region && s.output != "-") check_can_be_written(s.output);
  if (of_frame && s.coco != "-") check_can_be_written(s.coco);
}

}  // namespace

int features(const FeaturesSettings& settings) {
  set_up_log(settings.terrain.log_level);
  const std::string region = region_request(settings),
                    frame = settings.frame.empty() ? "" : read_request(settings.frame);
  if (region.empty() && frame.empty()) throw std::runtime_error("a REQUEST.json, --region or --coco is needed");
  check_outputs(settings, !region.empty(), !frame.empty());
  const api::Assets assets(settings.terrain.assets_dir, mesh_options(settings.terrain));
  const api::Limits limits = command_limits();
  const auto renderer = make_renderer(settings.terrain);
  std::vector<Written> all;
  const api::Response answer = api::answer_or_problem({}, [&] {
    const auto json = [&](const std::string& text) { return api::parse_json(text, limits.max_json_depth); };
    if (!region.empty()) all.push_back(of_region(json(region), settings, *renderer, assets, limits));
    if (!frame.empty()) all.push_back(of_frame(json(frame), settings, *renderer, assets, limits));
    return api::Response{};
  });
  if (answer.status != 200) {
    print_problem(answer);
    return 1;
  }
  for (const Written& written : all) {
    if (written.path == "-") {
      fmt::print("{}", written.text);
    } else {
      write_whole(written.path, written.text);
      fmt::print(said_beside(written.path), "{}", written.said);
    }
  }
  return 0;
}

}  // namespace selenograph::server
