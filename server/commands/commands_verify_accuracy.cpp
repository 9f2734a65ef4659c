// `selenograph verify accuracy`: tabulates time and error of a frame for every setting.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <thread>

#include "api/answers/accuracy_report.h"
#include "api/requests/frame_json.h"
#include "engine/verify/accuracy_sweep.h"
#include "engine/verify/indirect_error.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/place.h"
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

void print_summary(const std::vector<engine::SweepRow>& rows) {
  fmt::print("{:<10}{:<10}{:>14}{:>12}{:>9}{:>14}{:>16}{:>14}\n", "scene", "visibility", "max_error_px", "samples",
             "time", "points px", "shadow edge px", "radiance %");
  for (const engine::SweepRow& r : rows)
    fmt::print("{:<10}{:<10}{:>14g}{:>12}{:>9.2f}{:>14.3f}{:>16.3f}{:>14.2f}\n", r.scene,
               api::visibility_name(r.visibility), r.setting.max_error_px, api::samples_text(r.setting), r.ratio(),
               r.errors.geometric_px.p999, r.errors.shadow_edge_mean_px, 100 * r.errors.radiance_rms);
}

// Returns the scenes to measure. Throws if one of --scenes needs another option.
std::vector<engine::AccuracyScene> scenes_of(const VerifyAccuracySettings& s, const engine::Renderer& renderer) {
  const SceneCenters centers = scene_centers(s, renderer.terrain());
  const double height_m = s.height_m.value_or(
      s.indirect ? engine::height_over_posts_m(renderer.terrain(), centers.center, s.size_px) : 20e3);
  auto scenes = engine::accuracy_scenes(renderer.terrain(), centers.center, centers.polar, s.size_px, height_m);
  if (const auto detail = detail_of(s))
    scenes.push_back(engine::touchdown_scene(*renderer.terrain_with(detail), detail, centers.center, s.size_px));
  if (s.indirect)
    std::erase_if(scenes, [](const auto& scene) { return scene.name != "nadir" && scene.name != "polar"; });
  for (const std::string& name : s.scenes)
    if (std::ranges::find(scenes, name, &engine::AccuracyScene::name) == scenes.end())
      throw std::runtime_error("--scenes " + name +
                               (name == "polar" ? " needs --polar-center"
                                : s.indirect    ? ": --indirect measures nadir and polar"
                                                : " needs --detail"));
  if (!s.scenes.empty())
    std::erase_if(scenes, [&](const auto& scene) { return std::ranges::find(s.scenes, scene.name) == s.scenes.end(); });
  return scenes;
}

// Returns a scene's frame under each of the requested Suns, with the Sun's elevation.
std::vector<std::pair<double, engine::FrameRequest>> under_suns(const engine::AccuracyScene& scene,
                                                                const VerifyAccuracySettings& s) {
  const engine::FrameRequest& request = scene.frames.front();
  const EastNorthUp axes = local_axes(request.pose.position_m);
  std::vector<std::pair<double, engine::FrameRequest>> out;
  for (const double elevation_deg : s.suns_deg) {
    out.emplace_back(elevation_deg, request);
    out.back().second.sun.direction = engine::sun_direction(axes, s.sun_azimuth_deg, elevation_deg);
  }
  if (out.empty()) out.emplace_back(std::asin(request.sun.direction.dot(axes.up)) * kDegreesPerRadian, request);
  return out;
}

// Measures the error of light from terrain against processor time. Each row has its own renderer, whose light cache is
// empty.
int verify_indirect(const VerifyAccuracySettings& s, const TerrainSettings& terrain, const engine::Renderer& renderer,
                    const std::vector<engine::AccuracyScene>& scenes) {
  std::string table;
  const auto add = [&](const std::string& line) {
    table += line;
    fmt::print("{}", line);
    std::fflush(stdout);
  };
  add("| scene | Sun | spacing_px | ratio | median % | RMS % | worst % | shadow ratio | shadow RMS % | without ms | "
      "first ms | new Sun ms | kept ms |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const engine::AccuracyScene& scene : scenes)
    for (const auto& [elevation_deg, request] : under_suns(scene, s)) {
      // Ground lit by a low Sun is seen as thin strips: sample low elevations more densely.
      constexpr double kLow_deg = 5;
      const engine::IndirectTruth truth(renderer, request, elevation_deg < kLow_deg ? 768 : 256);
      for (const double spacing_px : {0.5, 1.0, 2.0, 4.0, 8.0}) {
        const auto row = engine::measure_indirect(*make_renderer(terrain), truth, spacing_px, s.repetitions);
        const auto& error = row.error;
        add(fmt::format(
            "| {} | {:.3g} | {:g} | {:.3f} | {:.2f} | {:.2f} | {:.2f} | {:.3f} | {:.2f} | {:.1f} | {:.0f} | {:.0f} | "
            "{:.1f} |\n",
            scene.name, elevation_deg, spacing_px, error.ratio, 100 * error.median, 100 * error.rms, 100 * error.worst,
            error.shadow_ratio, 100 * error.shadow_rms, row.without_ms, row.first_ms, row.new_sun_ms, row.kept_ms));
      }
    }
  write_whole((fs::path(s.output) / "indirect.md").string(), table);
  fmt::print("{}\n", machine());
  return 0;
}

}  // namespace

int verify_accuracy(const VerifyAccuracySettings& settings) {
  set_up_log(settings.terrain.log_level);
  TerrainSettings terrain = settings.terrain;
  if (terrain.dem.empty()) terrain.dem = sample_folders(terrain.cache_dir);
  const auto renderer = make_renderer(terrain);
  const auto scenes = scenes_of(settings, *renderer);
  fs::create_directories(settings.output);
  if (settings.indirect) return verify_indirect(settings, terrain, *renderer, scenes);
  engine::SweepOptions options;
  options.repetitions = settings.repetitions;
  options.reference_samples = settings.reference_samples;
  ProgressBar bar;
  const auto rows =
      engine::sweep(*renderer, scenes, options, [&](std::size_t done, std::size_t total, const auto& next) {
        bar.show(static_cast<double>(done) / static_cast<double>(total), next);
      });
  const fs::path folder = settings.output;
  write_whole((folder / "accuracy.csv").string(), api::accuracy_csv(rows));
  write_whole((folder / "accuracy.md").string(), api::accuracy_markdown(rows, scenes, machine()));
  write_json((folder / "accuracy.json").string(), api::accuracy_json(scenes, machine()));
  print_summary(rows);
  fmt::print("{0}: accuracy.csv, accuracy.json, accuracy.md; pictures: deploy/plot {0}\n", settings.output);
  return 0;
}

}  // namespace selenograph::server
