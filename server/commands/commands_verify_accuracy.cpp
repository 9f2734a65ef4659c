// `selenograph verify accuracy`: tabulates time and error of a frame for every setting.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <thread>

#include "api/answers/accuracy_report.h"
#include "api/assets/assets.h"
#include "api/requests/frame_json.h"
#include "engine/verify/accuracy_sweep.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/place.h"
#include "server/commands/request_file.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

// Returns sample terrain for the scenes: posts every 15 m below the nearer views, every 474 m out to the horizon of the
// limb, every 59 m near the south pole.
std::vector<std::string> sample_folders(const std::string& cache_dir) {
  dem::SampleOptions near, far, polar;
  near.south_deg = -7;
  near.west_deg = 39;
  near.rows = 2;
  near.columns = 2;
  near.posts_per_degree = 2048;
  far.south_deg = -16;
  far.west_deg = 30;
  far.rows = 20;
  far.columns = 20;
  far.posts_per_degree = 64;
  polar.south_deg = -88;
  polar.west_deg = 30;
  polar.rows = 2;
  polar.columns = 24;
  polar.posts_per_degree = 512;
  return {sample_folder(cache_dir, near), sample_folder(cache_dir, far), sample_folder(cache_dir, polar)};
}
constexpr Geographic kSampleCenter{-6, 40, 0}, kSamplePolarCenter{-87, 42, 0};

// Places of the scenes; no polar scene without a place.
struct SceneCenters {
  Geographic center;
  std::optional<Geographic> polar;
};

// Returns the places by the options; by default those of the sample terrain, or the middle of the finest DEM file.
SceneCenters scene_centers(const VerifyAccuracySettings& s, const dem::Terrain& terrain) {
  SceneCenters centers;
  if (s.terrain.dem.empty()) {
    centers = {kSampleCenter, kSamplePolarCenter};
  } else if (s.center.empty()) {
    const std::vector<dem::RasterInfo>& rasters = terrain.catalogue().rasters();
    const auto finest = std::min_element(rasters.begin(), rasters.end(), [](const auto& a, const auto& b) {
      return a.post_spacing_m < b.post_spacing_m;
    });
    if (finest == rasters.end()) throw std::runtime_error("the catalogue has no DEM file to measure on");
    const dem::Footprint& f = finest->footprint;
    centers.center = {(f.south_deg + f.north_deg) / 2, (f.west_deg + f.east_deg) / 2, 0};
  }
  if (!s.center.empty()) centers.center = place_of(s.center).value();
  if (!s.polar_center.empty()) centers.polar = place_of(s.polar_center).value();
  return centers;
}

// Returns the detail of the scene "touchdown"; null without --detail.
std::shared_ptr<const dem::Detail> detail_of(const VerifyAccuracySettings& s) {
  if (s.detail.empty()) return nullptr;
  return detail_of(s.detail, s.terrain);
}

// Describes the machine of the measured times: "AMD EPYC, 2 cores".
std::string machine() {
  std::ifstream info("/proc/cpuinfo");
  std::string name = "an unnamed processor";
  for (std::string line; std::getline(info, line);)
    if (const auto colon = line.find(": "); line.starts_with("model name") && colon != std::string::npos) {
      name = line.substr(colon + 2);
      break;
    }
  return fmt::format("{}, {} cores", name, std::thread::hardware_concurrency());
}

// Prints the rows with the default targets for shadows and detail, and each scene's own setting.
void print_summary(const std::vector<engine::SweepRow>& rows, const std::vector<engine::AccuracyScene>& scenes) {
  const engine::Accuracy standard;
  fmt::print("{:<10}{:<10}{:>14}{:>12}{:>10}{:>9}{:>14}{:>16}{:>14}\n", "scene", "visibility", "max_error_px",
             "samples", "ms", "ratio", "points px", "shadow edge px", "radiance %");
  for (const engine::SweepRow& r : rows) {
    const bool is_own = std::ranges::any_of(
        scenes, [&](const engine::AccuracyScene& scene) { return scene.name == r.scene && r.setting == scene.own; });
    const bool has_default_targets = r.setting.max_shadow_error_px == standard.max_shadow_error_px &&
                                     r.setting.max_detail_error_px == standard.max_detail_error_px;
    if (!is_own && !has_default_targets) continue;
    fmt::print("{:<10}{:<10}{:>14g}{:>12}{:>10.1f}{:>9.2f}{:>14.3f}{:>16.3f}{:>14.2f}{}\n", r.scene,
               api::visibility_name(r.visibility), r.setting.max_error_px, r.setting.samples_per_pixel, r.frame_ms,
               r.ratio(), r.errors.geometric_px.p999, r.errors.shadow_edge_mean_px, 100 * r.errors.radiance_rms,
               is_own ? "  <- as requested" : "");
  }
  for (const engine::AccuracyScene& scene : scenes) {
    const auto row = std::ranges::find(rows, scene.name, &engine::SweepRow::scene);
    if (row != rows.end() && row->reference_max_error_px > 0)
      fmt::print("{}: {} of the reference is {:.3g}\n", scene.name,
                 row->with_detail ? "max_detail_error_px" : "max_error_px", row->reference_max_error_px);
  }
}

// Returns the scenes to measure. Throws if one of --scenes needs another option.
std::vector<engine::AccuracyScene> scenes_of(const VerifyAccuracySettings& s, const engine::Renderer& renderer,
                                             const SceneCenters& centers) {
  auto scenes = engine::accuracy_scenes(renderer.terrain(), centers.center, centers.polar, s.size_px, s.height_m);
  if (const auto detail = detail_of(s))
    scenes.push_back(engine::touchdown_scene(*renderer.terrain_with(detail), detail, centers.center, s.size_px));
  for (const std::string& name : s.scenes)
    if (std::ranges::find(scenes, name, &engine::AccuracyScene::name) == scenes.end())
      throw std::runtime_error("--scenes " + name + (name == "polar" ? " needs --polar-center" : " needs --detail"));
  if (!s.scenes.empty())
    std::erase_if(scenes, [&](const auto& scene) { return std::ranges::find(s.scenes, scene.name) == s.scenes.end(); });
  return scenes;
}

// Throws RequestError for a frame whose errors cannot be measured.
void refuse_unmeasurable(const api::Json& body, const api::FrameQuery& query) {
  const auto refuse = [](const std::string& pointer, const std::string& why) {
    throw api::RequestError("invalid_request", "the frame's errors cannot be measured", {{pointer, why}});
  };
  if (!body.contains("sun")) refuse("/sun", "is required: it casts the shadows");
  if (!query.request.terrain) refuse("/terrain", "must not be false: errors are the terrain's");
  if (query.request.shutter) refuse("/shutter", "must be left out: points are compared at one pose");
  if (query.budget_ms) refuse("/accuracy/budget_ms", "must be left out: every setting is measured");
}

// Reads the scene of --request. Throws std::runtime_error with all faults of the file.
engine::AccuracyScene requested_scene(const VerifyAccuracySettings& s, const engine::Renderer& renderer) {
  const api::Assets assets(s.terrain.assets_dir, mesh_options(s.terrain));
  const api::Limits limits = command_limits();
  try {
    const api::Json body = api::parse_json(read_request(s.request));
    const api::FrameQuery query = api::read_frame(body, limits, assets, {}, ground_heights(renderer));
    refuse_unmeasurable(body, query);
    engine::FrameRequest frame = query.request;
    // None of these is measured.
    frame.sensor.reset();
    frame.sky.reset();
    frame.craters.reset();
    frame.flow_to.reset();
    frame.truth.reset();
    const engine::Accuracy own = frame.accuracy;
    return {"request", s.request == "-" ? "from standard input" : s.request, {std::move(frame)}, own};
  } catch (const api::RequestError& e) {
    throw std::runtime_error(s.request + ": " + with_findings(e));
  }
}

// Measures speed against error in scenes.
int verify_scenes(const VerifyAccuracySettings& settings, const engine::Renderer& renderer,
                  const std::vector<engine::AccuracyScene>& scenes, engine::SweepOptions options = {}) {
  fs::create_directories(settings.output);
  options.repetitions = settings.repetitions;
  options.reference_samples = settings.reference_samples;
  ProgressBar bar;
  const auto rows =
      engine::sweep(renderer, scenes, options, [&](std::size_t done, std::size_t total, const auto& next) {
        bar.show(static_cast<double>(done) / static_cast<double>(total), next);
      });
  const fs::path folder = settings.output;
  write_whole((folder / "accuracy.csv").string(), api::accuracy_csv(rows));
  write_json((folder / "accuracy.json").string(), api::accuracy_json(scenes, machine()));
  print_summary(rows, scenes);
  fmt::print("{0}: accuracy.csv, accuracy.json; pictures: deploy/plot {0}\n", settings.output);
  return 0;
}

}  // namespace

int verify_accuracy(const VerifyAccuracySettings& settings) {
  set_up_log(settings.terrain.log_level);
  TerrainSettings terrain = settings.terrain;
  if (terrain.dem.empty() && settings.request.empty()) terrain.dem = sample_folders(terrain.cache_dir);
  const auto renderer = make_renderer(terrain);
  if (!settings.request.empty()) {
    const engine::AccuracyScene scene = requested_scene(settings, *renderer);
    return verify_scenes(settings, *renderer, {scene}, {.methods = {scene.frames.front().visibility}});
  }
  const SceneCenters centers = scene_centers(settings, renderer->terrain());
  return verify_scenes(settings, *renderer, scenes_of(settings, *renderer, centers));
}

}  // namespace selenograph::server
