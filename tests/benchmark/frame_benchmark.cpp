// How near a frame comes to what Embree alone needs for its rays: both in one process, alternating, medians.
//
//   build/selenograph_benchmark [--dem PATH]... [Google Benchmark options]
//
// Without --dem the sample terrain is generated into a temporary folder. Each benchmark's `ratio` counter is the median
// time of our warm frame (1024 x 1024, radiance with hard shadows) over that of the bare kernel on the same mesh,
// camera and Sun.
#include <benchmark/benchmark.h>
#include <fmt/format.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <numbers>

#include "dem/sample_terrain.h"
#include "engine/bare_kernel.h"
#include "engine/pixel_rays.h"
#include "engine/raster_pass.h"
#include "engine/render_pass.h"
#include "engine/scene.h"

namespace selenograph {
namespace {

using Clock = std::chrono::steady_clock;

struct Place {
  double lat_deg, lon_deg;
};

// What of the whole request is measured: 1024 x 1024 pixels, 50 degrees wide.
engine::FrameRequest request(const Place& place, double height_m, double tilt_deg, double sun_deg) {
  constexpr double kRadians = std::numbers::pi / 180;
  engine::FrameRequest r;
  const double f = 512 / std::tan(25 * kRadians);
  r.camera = {1024, 1024, f, f, 511.5, 511.5, {}};
  const Vec3 position = to_cartesian({place.lat_deg, place.lon_deg, height_m});
  const EastNorthUp axes = local_axes(position);
  const Vec3 z = -axes.up * std::cos(tilt_deg * kRadians) + axes.north * std::sin(tilt_deg * kRadians), x = axes.east;
  Eigen::Matrix3d rows;
  rows << x.transpose(), z.cross(x).transpose(), z.transpose();
  r.pose = {position, Eigen::Quaterniond(rows)};
  r.sun.direction = axes.up * std::sin(sun_deg * kRadians) + axes.east * std::cos(sun_deg * kRadians);
  r.products = engine::kRadiance;
  return r;
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

template <typename Work>
double milliseconds(Work&& work) {
  const auto start = Clock::now();
  work();
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

void compare(benchmark::State& state, const std::shared_ptr<dem::Terrain>& terrain, const Place& place, double height_m,
             double tilt_deg, double sun_deg) {
  const engine::FrameRequest r = request(place, height_m, tilt_deg, sun_deg);
  const engine::View view(r.camera, r.pose);
  const engine::Selection selection = engine::select_for_view(*terrain, view, &r.sun, r.accuracy, {});
  const Vec3 anchor = engine::anchor_for(view.position(), view.middle());
  const int threads = tbb::this_task_arena::max_concurrency();
  const engine::Scene scene(*terrain, selection, anchor, threads);
  const engine::Scene raster_scene(*terrain, selection, anchor, threads, engine::Visibility::zbuffer);
  const engine::BareKernel kernel(scene.mesh, anchor, threads);
  engine::FrameScratch scratch;
  std::vector<float> image;
  std::vector<double> bare, ours, zbuffer;
  for (auto _ : state) {
    if (getenv("ONLY")) bare.push_back(1); else bare.push_back(milliseconds([&] { kernel.render(view, r.sun.direction, scene.shell_m, image); }));
    // All that a warm frame does but for looking up its scene: choosing blocks, rays, refinement, shadows, radiance.
    const auto frame = [&](const engine::Scene& warm) {
      benchmark::DoNotOptimize(engine::select_for_view(*terrain, view, &r.sun, r.accuracy, {}));
      engine::FrameProducts products;
      engine::render_pixels(warm, view, r, {}, terrain->catalogue().rasters().size(), {}, scratch, products);
      benchmark::DoNotOptimize(products.radiance.data());
    };
    if (getenv("ONLY")) ours.push_back(1); else ours.push_back(milliseconds([&] { frame(scene); }));
    if (getenv("ONLY")) for (int k = 0; k < 20; ++k) frame(raster_scene);
    zbuffer.push_back(milliseconds([&] { frame(raster_scene); }));
    state.SetIterationTime(ours.back() / 1000);
  }
  double triangles = 0;
  for (const auto& b : scene.mesh.blocks()) triangles += 2.0 * b.posts->extent.quads * b.posts->extent.quads;
  state.counters["bare_ms"] = median(bare);
  state.counters["ours_ms"] = median(ours);
  state.counters["ratio"] = median(ours) / median(bare);
  state.counters["zbuffer_ms"] = median(zbuffer);
  state.counters["gain"] = median(ours) / median(zbuffer);
  state.counters["Mtriangles"] = triangles / 1e6;
}

}  // namespace
}  // namespace selenograph

int main(int argc, char** argv) {
  using namespace selenograph;
  std::vector<std::string> paths;
  std::vector<char*> rest{argv[0]};
  for (int i = 1; i < argc; ++i) {
    if (std::string(argv[i]) == "--dem" && i + 1 < argc)
      paths.emplace_back(argv[++i]);
    else
      rest.push_back(argv[i]);
  }
  if (paths.empty()) {
    const std::string folder = (std::filesystem::temp_directory_path() / "selenograph-benchmark-terrain").string();
    dem::write_sample_terrain(folder, {});
    paths.push_back(folder);
  }
  dem::TerrainOptions options;
  options.cache_bytes = std::size_t{4} << 30;
  const auto terrain = std::make_shared<dem::Terrain>(dem::Catalogue(paths), options);
  double south = 90, north = -90, west = 360, east = -360;
  for (const auto& info : terrain->catalogue().rasters()) {
    south = std::min(south, info.footprint.south_deg), north = std::max(north, info.footprint.north_deg);
    west = std::min(west, info.footprint.west_deg), east = std::max(east, info.footprint.east_deg);
  }
  const Place centre{(south + north) / 2, (west + east) / 2};
  for (const auto& [name, height, tilt] : {std::tuple{"nadir", 30000.0, 0.0}, {"oblique60", 20000.0, 60.0}})
    for (const double sun : {3.0, 15.0, 45.0})
      benchmark::RegisterBenchmark(fmt::format("{}/sun{}", name, sun).c_str(),
                                   [=](benchmark::State& state) { compare(state, terrain, centre, height, tilt, sun); })
          ->Unit(benchmark::kMillisecond)
          ->UseManualTime()
          ->Iterations(21);
  int count = static_cast<int>(rest.size());
  benchmark::Initialize(&count, rest.data());
  benchmark::RunSpecifiedBenchmarks();
}
