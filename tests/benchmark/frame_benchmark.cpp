// What a frame costs by either way to see, and how near rays come to what Embree alone needs: all in one process,
// alternating, medians.
//
//   build/selenograph_benchmark [--dem PATH]... [--target NAME] [Google Benchmark options]
//
// Without --dem the sample terrain is generated into a temporary folder. Frames are 1024 x 1024 but where the name says
// otherwise, radiance with exact shadows, warm. Counters: rays_ms and zbuffer_ms, and their ratio, `gain`; bare_ms, the
// time of the bare kernel on the same mesh, camera and Sun, and `ratio`, rays_ms over it; auto_loss: how much slower
// than the faster way the one is that "auto" chooses. adds/...: what radiometry and sensor cost beside the plain frame.
// --target: the vectors to use at most (AVX3, AVX2, ...), for the z-buffer; Embree chooses its own.
#include "dem/base/vector_targets.h"
// Highway's headers come after it: which sets of vectors they know depends on it.
#include <benchmark/benchmark.h>
#include <fmt/format.h>
#include <hwy/targets.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>
#include <string_view>
#include <vector>

#include "dem/base/quantile.h"
#include "dem/gdal/geotiff_writer.h"
#include "dem/sample/sample_terrain.h"
#include "dem/value_maps/value_map.h"
#include "engine/frames/render_frame.h"
#include "engine/radiometry/atmosphere.h"
#include "engine/renderer.h"
#include "engine/scene/anchor.h"
#include "engine/verify/bare_kernel.h"
#include "engine/visibility/objects/object_mesh.h"

namespace selenograph {
namespace {

using Clock = std::chrono::steady_clock;

struct Place {
  double lat_deg, lon_deg;
};

// A frame 50 degrees wide.
struct Setting {
  std::string name;
  double height_m = 0, tilt_deg = 0, sun_deg = 15;
  int side = 1024;
  double max_error_px = engine::Accuracy{}.max_error_px;
  double angular_radius_deg = 0;
  bool lens = false, build = false;  // build: the scene is made anew in every frame
  bool above_ground = false;         // height_m is; else above the sphere
  int frames = 21;
};

engine::FrameRequest request(const dem::Terrain& terrain, const Place& place, const Setting& setting) {
  constexpr double kRadians = std::numbers::pi / 180;
  engine::FrameRequest r;
  const double f = setting.side / 2.0 / std::tan(25 * kRadians), middle = (setting.side - 1) / 2.0;
  r.camera = {setting.side, setting.side, f, f, middle, middle, {}};
  if (setting.lens) r.camera.distortion = {-0.25, 0.08, 0, 1e-3, -1e-3};
  const double ground_m = setting.above_ground ? terrain.height(place.lat_deg, place.lon_deg).height_m : 0;
  const Vec3 position = to_cartesian({place.lat_deg, place.lon_deg, ground_m + setting.height_m});
  const EastNorthUp axes = local_axes(position);
  const double tilt = setting.tilt_deg * kRadians, sun = setting.sun_deg * kRadians;
  const Vec3 z = -axes.up * std::cos(tilt) + axes.north * std::sin(tilt), x = axes.east;
  r.pose = {position, Quat(Mat3::from_rows(x, z.cross(x), z))};
  r.sun.direction = axes.up * std::sin(sun) + axes.east * std::cos(sun);
  r.sun.angular_radius_deg = setting.angular_radius_deg;
  r.accuracy.max_error_px = setting.max_error_px;
  r.products = engine::kRadiance;
  return r;
}

template <typename Work>
double milliseconds(Work&& work) {
  const auto start = Clock::now();
  work();
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

void compare(benchmark::State& state, const std::shared_ptr<dem::PyramidTerrain>& terrain, const Place& place,
             const Setting& setting) {
  const engine::FrameRequest r = request(*terrain, place, setting);
  const engine::View view(r.camera, r.pose);
  const engine::Selection selection = engine::select_for_view(*terrain, view, &r.sun, r.accuracy, {});
  const Vec3 anchor = engine::anchor_for(view.position(), view.middle());
  const int threads = tbb::this_task_arena::max_concurrency();
  engine::RenderCache kept(terrain, std::size_t{1} << 36, threads);
  const auto content_of = [&](engine::Visibility visibility) {
    return engine::SceneContent{selection.blocks, anchor, visibility};
  };
  const auto ray_scene = kept.scene(content_of(engine::Visibility::raytrace));
  kept.scene(content_of(engine::Visibility::zbuffer));
  const auto frame_ms = [&](engine::Visibility visibility) {
    engine::FrameRequest asked = r;
    asked.visibility = visibility;
    if (setting.build) kept.forget(content_of(visibility));
    return milliseconds([&] { benchmark::DoNotOptimize(engine::render_frame(asked, {*terrain, kept, {}})); });
  };
  const bool plain = !setting.build && !setting.lens && setting.angular_radius_deg == 0;
  const engine::BareKernel kernel(ray_scene->mesh, anchor, threads);
  std::vector<float> image;
  std::vector<double> bare, rays, zbuffer;
  for (auto _ : state) {
    if (plain) bare.push_back(milliseconds([&] { kernel.render(view, r.sun.direction, ray_scene->shell_m, image); }));
    rays.push_back(frame_ms(engine::Visibility::raytrace));
    zbuffer.push_back(frame_ms(engine::Visibility::zbuffer));
    state.SetIterationTime(zbuffer.back() / 1000);
  }
  double triangles = 0;
  for (const auto& b : ray_scene->mesh.blocks()) triangles += 2.0 * b.posts->extent.quads * b.posts->extent.quads;
  if (plain) {
    state.counters["bare_ms"] = median(bare);
    state.counters["ratio"] = median(rays) / median(bare);
  }
  state.counters["rays_ms"] = median(rays);
  state.counters["zbuffer_ms"] = median(zbuffer);
  state.counters["gain"] = median(rays) / median(zbuffer);
  const bool drawn =
      engine::visibility_for(r, engine::RowViews(r.camera, r.pose, {}), selection) == engine::Visibility::zbuffer;
  state.counters["auto_loss"] = (drawn ? median(zbuffer) : median(rays)) / std::min(median(zbuffer), median(rays)) - 1;
  state.counters["Mtriangles"] = triangles / 1e6;
}

// What a request adds to the lander's frame, by z-buffer, alternating with it: "cost nothing in scenes that don't need
// it".
struct Addition {
  const char* name;
  void (*add)(engine::FrameRequest& request);
  double sun_deg = 15;
};

constexpr double kSunRadius_deg = 0.2666;
void add_disc(engine::FrameRequest& r) { r.sun.angular_radius_deg = kSunRadius_deg; }

engine::SensorModel noisy_sensor() {
  engine::SensorModel s;
  s.optics.f_number = 5.6;
  engine::Detector& d = s.detector;
  d.pixel_pitch_um = 5.5, d.quantum_efficiency = 0.4, d.integration_time_s = 0.002, d.full_well_e = 13500;
  d.dark_current_e_s = 125, d.read_noise_e = 13, d.prnu = 0.01, d.dsnu_e = 4, d.gain_e_dn = 3.4, d.bit_depth = 12;
  return s;
}

// A map of the whole Moon, 3.8 km to a texel.
std::shared_ptr<const dem::ValueMap> grey_map() {
  constexpr int kAcross = 2880, kDown = 1440;
  static const auto map = [] {
    const std::string path = std::filesystem::temp_directory_path() / "selenograph-benchmark-albedo.tif";
    std::vector<float> values(static_cast<std::size_t>(kAcross) * kDown);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = 0.1F + 0.001F * static_cast<float>(i % 97);
    dem::write_geotiff(path, {90 - 0.0625, -180 + 0.0625, 0.125, 0.125, kAcross, kDown}, values, "albedo");
    dem::ValueMapOptions options;
    options.path = path;
    return std::make_shared<const dem::ValueMap>(options, dem::make_value_map_tiles(std::size_t{128} << 20));
  }();
  return map;
}

// A box of 40 m, so far in front of the camera (or behind it).
engine::SceneObject box_below(const engine::FrameRequest& r, double ahead_m) {
  engine::ObjectShape shape;
  for (int i = 0; i < 8; ++i)
    shape.corners.push_back({{i & 1 ? 20.F : -20.F, i & 2 ? 20.F : -20.F, i & 4 ? 20.F : -20.F}, {0, 0, 0}});
  for (const auto& t : {std::array<std::uint32_t, 3>{0, 1, 3},
                        {0, 3, 2},
                        {4, 5, 7},
                        {4, 7, 6},
                        {0, 1, 5},
                        {0, 5, 4},
                        {2, 3, 7},
                        {2, 7, 6},
                        {0, 2, 6},
                        {0, 6, 4},
                        {1, 3, 7},
                        {1, 7, 5}})
    shape.triangles.push_back({t, 0});
  shape.parts = {"box"};
  const Vec3 boresight = r.pose.camera_from_moon.conjugate() * Vec3::unit_z();
  return {std::make_shared<const engine::ObjectMesh>(shape),
          r.pose.position_m + ahead_m * boresight,
          Quat(0.8, 0.36, 0.48, 0),
          1,
          {engine::Material()}};
}

void add_model(engine::FrameRequest& r, engine::ReflectanceModel model) { r.reflectance.model = model; }

const Addition kAdditions[] = {
    {"nothing", [](engine::FrameRequest&) {}},
    {"disc/sun3", add_disc, 3},
    {"disc/sun15", add_disc, 15},
    {"disc/sun45", add_disc, 45},
    {"samples", [](engine::FrameRequest& r) { r.accuracy.samples_per_pixel = 4; }},
    {"band", [](engine::FrameRequest& r) { r.band.emplace(0.65, 0.3); }},
    {"temperature", [](engine::FrameRequest& r) { r.band.emplace(10, 1), r.temperature_k = 350; }},
    {"atmosphere",
     [](engine::FrameRequest& r) {
       r.band.emplace(0.65, 0.3);
       r.atmosphere = std::make_shared<engine::Atmosphere>(
           std::vector<engine::AtmosphereRow>{{0.4, 0.7, 1500, 5, 20, 0}, {0.9, 0.9, 900, 1, 2, 0}});
     }},
    {"blinn_phong", [](engine::FrameRequest& r) { add_model(r, engine::ReflectanceModel::blinn_phong); }},
    {"lunar_lambert", [](engine::FrameRequest& r) { add_model(r, engine::ReflectanceModel::lunar_lambert); }},
    {"phase_law",
     [](engine::FrameRequest& r) {
       add_model(r, engine::ReflectanceModel::lommel_seeliger), r.reflectance.phase = engine::PhaseLaw::rolo;
     }},
    {"hapke", [](engine::FrameRequest& r) { add_model(r, engine::ReflectanceModel::hapke); }},
    {"hapke_2002",
     [](engine::FrameRequest& r) {
       add_model(r, engine::ReflectanceModel::hapke);
       r.reflectance.hapke.terms = engine::HapkeTerms::terms_2002, r.reflectance.hapke.bc0 = 0.3;
     }},
    {"moon", [](engine::FrameRequest& r) { add_model(r, engine::ReflectanceModel::moon); }},
    {"albedo_map", [](engine::FrameRequest& r) { r.albedo_maps = {grey_map()}; }},
    {"moon_albedo_map",
     [](engine::FrameRequest& r) { add_model(r, engine::ReflectanceModel::moon), r.albedo_maps = {grey_map()}; }},
    {"object_in_view", [](engine::FrameRequest& r) { r.objects = {box_below(r, 300)}; }},
    {"object_out_of_view", [](engine::FrameRequest& r) { r.objects = {box_below(r, -300)}; }},
    {"noise", [](engine::FrameRequest& r) { r.band.emplace(0.65, 0.3), r.sensor = noisy_sensor(); }},
    {"noise_and_point_spread",
     [](engine::FrameRequest& r) {
       r.band.emplace(0.65, 0.3), r.sensor = noisy_sensor();
       r.sensor->optics.point_spread = {engine::PointSpread::Model::gaussian, 0.6, {}, 0};
       r.sensor->optics.vignetting.model = engine::Vignetting::Model::cos4;
     }},
};

void add(benchmark::State& state, const std::shared_ptr<dem::PyramidTerrain>& terrain, const Place& place,
         const Addition& addition) {
  const engine::FrameRequest plain =
      request(*terrain, place, {.name = "", .height_m = 30000, .tilt_deg = 0, .sun_deg = addition.sun_deg});
  engine::FrameRequest more = plain;
  addition.add(more);
  if (more.sensor) more.products = engine::kImage;
  const engine::Renderer renderer(terrain, {});
  std::vector<double> without, with, sensor;
  renderer.render(plain), renderer.render(more);
  for (auto _ : state) {
    without.push_back(milliseconds([&] { benchmark::DoNotOptimize(renderer.render(plain)); }));
    engine::Frame frame;
    with.push_back(milliseconds([&] { frame = renderer.render(more); }));
    sensor.push_back(frame.times.sensor_ms / frame.times.visibility_ms);
    state.SetIterationTime(with.back() / 1000);
  }
  state.counters["plain_ms"] = median(without);
  state.counters["ms"] = median(with);
  state.counters["ratio"] = median(with) / median(without);
  // Where other processes take turns, the fastest frames are the ones that they left alone.
  state.counters["least_ratio"] =
      *std::min_element(with.begin(), with.end()) / *std::min_element(without.begin(), without.end());
  if (more.sensor) state.counters["sensor_over_visibility"] = median(sensor);
}

const Setting kSettings[] = {
    {.name = "nadir/sun3", .height_m = 30000, .tilt_deg = 0, .sun_deg = 3},
    {.name = "nadir/sun15", .height_m = 30000, .tilt_deg = 0, .sun_deg = 15},
    {.name = "nadir/sun45", .height_m = 30000, .tilt_deg = 0, .sun_deg = 45},
    {.name = "oblique60/sun3", .height_m = 20000, .tilt_deg = 60, .sun_deg = 3},
    {.name = "oblique60/sun15", .height_m = 20000, .tilt_deg = 60, .sun_deg = 15},
    {.name = "oblique60/sun45", .height_m = 20000, .tilt_deg = 60, .sun_deg = 45},
    {.name = "nadir/finer", .height_m = 60000, .tilt_deg = 0, .sun_deg = 15, .max_error_px = 0.02},
    {.name = "nadir/coarser", .height_m = 30000, .tilt_deg = 0, .sun_deg = 15, .max_error_px = 4},
    {.name = "nadir/256", .height_m = 30000, .tilt_deg = 0, .sun_deg = 15, .side = 256},
    {.name = "nadir/lens", .height_m = 30000, .tilt_deg = 0, .sun_deg = 15, .lens = true},
    {.name = "nadir/build", .height_m = 30000, .tilt_deg = 0, .sun_deg = 15, .build = true},
    {.name = "ground/2m", .height_m = 2, .tilt_deg = 85, .sun_deg = 15, .above_ground = true},
    {.name = "ground/200m", .height_m = 200, .tilt_deg = 85, .sun_deg = 15, .above_ground = true},
    {.name = "nadir/penumbra",
     .height_m = 30000,
     .tilt_deg = 0,
     .sun_deg = 15,
     .angular_radius_deg = kSunRadius_deg,
     .frames = 5},
    {.name = "oblique60/penumbra",
     .height_m = 20000,
     .tilt_deg = 60,
     .sun_deg = 15,
     .angular_radius_deg = kSunRadius_deg,
     .frames = 5},
};

// With the few pixels of many triangles for which rays may be faster.
std::vector<Setting> settings() {
  std::vector<Setting> all(std::begin(kSettings), std::end(kSettings));
  for (const int side : {256, 160, 112, 64}) {
    Setting dense{.name = {}, .height_m = 60000, .tilt_deg = 0, .side = side, .max_error_px = 0.02};
    for (const int sun_deg : {3, 15, 45}) {
      dense.name = fmt::format("dense/{}/sun{}", side, sun_deg), dense.sun_deg = sun_deg;
      all.push_back(dense);
    }
    dense.name = fmt::format("dense/{}/penumbra", side), dense.sun_deg = 15;
    dense.angular_radius_deg = kSunRadius_deg, dense.frames = 5;
    all.push_back(dense);
  }
  return all;
}

// The vectors that Highway may choose from: those and whatever is older.
bool use_at_most(std::string_view name) {
  std::int64_t wanted = 0;
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets())
    if (name == hwy::TargetName(target)) wanted = target;
  if (wanted == 0) return false;
  hwy::DisableTargets(wanted - 1);  // a newer target has a lower bit
  return true;
}

}  // namespace
}  // namespace selenograph

int main(int argc, char** argv) {
  using namespace selenograph;
  std::vector<std::string> paths;
  std::vector<char*> rest{argv[0]};
  for (int i = 1; i < argc; ++i) {
    if (std::string_view(argv[i]) == "--dem" && i + 1 < argc) {
      paths.emplace_back(argv[++i]);
    } else if (std::string_view(argv[i]) == "--target" && i + 1 < argc) {
      if (use_at_most(argv[++i])) continue;
      fmt::print(stderr, "--target: {} is none of", argv[i]);
      for (const std::int64_t target : hwy::SupportedAndGeneratedTargets())
        fmt::print(stderr, " {}", hwy::TargetName(target));
      fmt::print(stderr, "\n");
      return 2;
    } else {
      rest.push_back(argv[i]);
    }
  }
  if (paths.empty()) {
    const std::string folder = (std::filesystem::temp_directory_path() / "selenograph-benchmark-terrain").string();
    dem::write_sample_terrain(folder, {});
    paths.push_back(folder);
  }
  dem::TerrainOptions options;
  options.cache_bytes = std::size_t{4} << 30;
  const auto terrain = std::make_shared<dem::PyramidTerrain>(dem::Catalogue(paths), options);
  double south = 90, north = -90, west = 360, east = -360;
  for (const auto& info : terrain->catalogue().rasters()) {
    south = std::min(south, info.footprint.south_deg), north = std::max(north, info.footprint.north_deg);
    west = std::min(west, info.footprint.west_deg), east = std::max(east, info.footprint.east_deg);
  }
  const Place centre{(south + north) / 2, (west + east) / 2};
  for (const Setting& setting : settings())
    benchmark::RegisterBenchmark(setting.name.c_str(),
                                 [=](benchmark::State& state) { compare(state, terrain, centre, setting); })
        ->Unit(benchmark::kMillisecond)
        ->UseManualTime()
        ->Iterations(setting.frames);
  for (const Addition& addition : kAdditions)
    benchmark::RegisterBenchmark((std::string("adds/") + addition.name).c_str(),
                                 [=](benchmark::State& state) { add(state, terrain, centre, addition); })
        ->Unit(benchmark::kMillisecond)
        ->UseManualTime()
        ->Iterations(41);
  int count = static_cast<int>(rest.size());
  benchmark::Initialize(&count, rest.data());
  benchmark::RunSpecifiedBenchmarks();
}
