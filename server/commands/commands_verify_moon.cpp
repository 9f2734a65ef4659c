// `selenograph verify moon`: compares the Moon's rendered brightness with models and with real images.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "api/answers/moon_report.h"
#include "api/encode/encode.h"
#include "api/encode/read_npz.h"
#include "api/message/problem.h"
#include "api/requests/frame_json.h"
#include "dem/files/files.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/place.h"
#include "server/commands/request_file.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// Nominal band of a channel of MSG SEVIRI (EUMETSAT). The array of an image has its channels in the order of kSeviri.
struct Channel {
  const char* name;
  double center_um, width_um;
};
constexpr Channel kSeviri[] = {{"VIS006", 0.635, 0.15}, {"VIS008", 0.81, 0.14}, {"NIR016", 1.64, 0.28}};

// SEVIRI reads three lines per rotation of 0.6 s. The lines begin in the direction of the Earth, which moves by 43.8
// urad per rotation; the Moon moves by 5.6 urad, from the satellite's 3.07 km/s and the Moon's 1 km/s in the opposite
// direction. A pixel is 83.9 urad.
constexpr engine::SpinScan kSeviriScan{3, 0.455};

// Reads images from NumPy's .npy: [channel, row, column].
std::vector<engine::DiscImage> read_images(const fs::path& path) {
  const api::NpzArray array = api::read_npy(dem::read_whole(path), path.string());
  const std::vector<std::size_t>& shape = array.shape;
  if (shape.size() != 3 || shape[0] < 1 || shape[1] < 2 || shape[2] < 2 || shape[0] > 16 || shape[1] > 8192 ||
      shape[2] > 8192)
    throw std::runtime_error(path.string() + ": must have three dimensions: channel, row, column");
  std::vector<engine::DiscImage> images;
  const auto image_pixels = static_cast<std::ptrdiff_t>(shape[1] * shape[2]);
  for (auto begin = array.numbers.begin(); begin != array.numbers.end(); begin += image_pixels)
    images.push_back(
        {static_cast<int>(shape[2]), static_cast<int>(shape[1]), std::vector<float>(begin, begin + image_pixels)});
  return images;
}

json surface_json(const VerifyMoonSettings& settings) {
  json surface{{"preset", "moon"}};
  if (!settings.albedo_maps.empty()) surface["albedo_maps"] = settings.albedo_maps;
  return surface;
}

// Returns the request with the options' surface. `what` names its origin in errors, std::runtime_error.
engine::FrameRequest read_request(json request, const VerifyMoonSettings& settings, const api::Assets& assets,
                                  const std::string& what) {
  request["surface"] = surface_json(settings);
  try {
    return api::read_frame(request, command_limits(), assets).request;
  } catch (const api::RequestError& e) {
    throw std::runtime_error(what + ": " + with_findings(e));
  }
}

// An image, the request for its frame, and the frame.
struct ImagePair {
  std::string image, channel;
  engine::FrameRequest request;
  engine::DiscImage observed, frame;
  engine::SpinScan scan;
};

// Renders the frame in W m-2 sr-1 um-1, the images' unit, with pixels a quarter as wide: an instrument spreads light
// and displaces lines before its pixels average.
engine::DiscImage fine_frame(engine::FrameRequest request, const engine::Renderer& renderer) {
  constexpr int kFactor = 4;
  engine::Camera& camera = request.camera;
  camera.width *= kFactor;
  camera.height *= kFactor;
  camera.fx *= kFactor;
  camera.fy *= kFactor;
  // Pixel centres are at whole numbers, so the image begins at -0.5: scale positions from there.
  camera.cx = (camera.cx + 0.5) * kFactor - 0.5;
  camera.cy = (camera.cy + 0.5) * kFactor - 0.5;
  std::vector<float> radiance = renderer.render(request).products.radiance;
  for (float& value : radiance) value = static_cast<float>(static_cast<double>(value) / request.band->width_um());
  return {camera.width, camera.height, std::move(radiance), kFactor};
}

// Returns each channel of each image in views.json with its frame.
std::vector<ImagePair> image_pairs(const VerifyMoonSettings& settings, const engine::Renderer& renderer,
                                   const api::Assets& assets) {
  const fs::path folder = settings.images;
  const json views = json::parse(dem::read_whole(folder / "views.json"), nullptr, false);
  if (!views.is_object()) throw std::runtime_error((folder / "views.json").string() + ": is not a JSON object");
  if (views.empty()) throw std::runtime_error((folder / "views.json").string() + ": names no image");
  std::vector<ImagePair> pairs;
  for (const auto& [name, view] : views.items()) {
    const auto images = read_images(folder / (name + ".npy"));
    const engine::SpinScan scan = engine::scan_of(images, kSeviriScan);
    for (std::size_t k = 0; k < std::min(images.size(), std::size(kSeviri)); ++k) {
      json body = view;
      body["band"] = {{"center_um", kSeviri[k].center_um}, {"width_um", kSeviri[k].width_um}};
      body["products"] = {"radiance"};
      ImagePair pair{name, kSeviri[k].name, read_request(body, settings, assets, "views.json: " + name), images[k], {},
                     scan};
      if (pair.request.camera.width != images[k].width || pair.request.camera.height != images[k].height)
        throw std::runtime_error(name + ": views.json and the .npy file have different sizes");
      pair.frame = fine_frame(pair.request, renderer);
      pairs.push_back(std::move(pair));
    }
  }
  return pairs;
}

// Returns the point spread's standard deviation with the best mean correlation over all images, before registration.
double fitted_spread_px(const std::vector<ImagePair>& pairs) {
  // Try 0.3 to 1.2 pixels in steps of 0.05. The sum of the correlations has the same maximum as their mean.
  double best_px = 0, best_sum = -1;
  for (int k = 6; k < 25; ++k) {
    const double sigma_px = 0.05 * k;
    double sum = 0;
    for (const ImagePair& pair : pairs)
      sum += engine::disc_correlation(pair.observed, engine::spread(pair.frame, {sigma_px, 0, 0, pair.scan}),
                                      engine::View(pair.request.camera, pair.request.pose));
    if (sum > best_sum) {
      best_sum = sum;
      best_px = sigma_px;
    }
  }
  return best_px;
}

// Registers each frame with its image, adds the comparison to the report, and writes both as .npy.
void compare_images(const VerifyMoonSettings& settings, const engine::Renderer& renderer, const api::Assets& assets,
                    api::MoonReport& report) {
  const std::vector<ImagePair> pairs = image_pairs(settings, renderer, assets);
  report.point_spread_px = fitted_spread_px(pairs);
  for (const ImagePair& pair : pairs) {
    const engine::View view(pair.request.camera, pair.request.pose);
    const engine::Placement placement =
        engine::registered(pair.observed, pair.frame, view, {report.point_spread_px, 0, 0, pair.scan});
    const engine::DiscImage frame = engine::spread(pair.frame, placement);
    // The camera as registered: its principal point is moved by the registration.
    engine::FrameRequest moved = pair.request;
    moved.camera.cx += placement.dx_px;
    moved.camera.cy += placement.dy_px;
    report.images.push_back({pair.image, pair.channel, pair.request.band->center_um(),
                             engine::compare_disc(pair.observed, frame, moved), placement});
    const auto write = [&](const char* what, const engine::DiscImage& image) {
      const api::ArrayView array{what, api::ElementType::float32, image.height, image.width, 1, image.radiance.data(),
                                 {}};
      write_whole((fs::path(settings.output) / fmt::format("{}.{}.{}.npy", pair.image, pair.channel, what)).string(),
                  api::encode_npy(array));
    };
    write("observed", pair.observed);
    write("frame", frame);
  }
}

// Throws std::runtime_error for options that need others.
void check_needs(const VerifyMoonSettings& s) {
  if (s.terrain.dem.empty() && !(s.images.empty() && s.center.empty() && s.albedo_maps.empty()))
    throw std::runtime_error("--images, --center and --albedo-maps need --dem: a DEM of the whole Moon");
  if (s.center.empty() && (!s.detail.empty() || s.width_m))
    throw std::runtime_error("--detail and --width-m need --center");
}

// Compares terrain at a place with smooth ground.
std::vector<engine::ReliefRow> relief_of(const VerifyMoonSettings& s, const engine::Renderer& renderer,
                                         const engine::FrameRequest& surface) {
  const Geographic center = place_of(s.center).value();
  if (!std::isfinite(renderer.terrain().height(center.lat_deg, center.lon_deg, {}).height_m))
    throw std::runtime_error("--center " + s.center + ": there is no terrain");
  return engine::relief_at(renderer, surface, center, s.width_m.value_or(20e3), s.size_px);
}

}  // namespace

int verify_moon(const VerifyMoonSettings& settings) {
  set_up_log(settings.terrain.log_level);
  check_needs(settings);
  fs::create_directories(settings.output);
  api::MoonReport report;
  report.discs = engine::discs_on_sphere();
  if (!settings.terrain.dem.empty()) {
    const auto renderer = make_renderer(settings.terrain);
    const api::Assets assets(settings.terrain.assets_dir);
    // Only the surface of this request is used; the rest makes it valid.
    json minimal_request{{"camera", {{"width", 64}, {"height", 64}, {"fov_deg", 1}}},
                         {"pose", {{"position_m", {384.4e6, 0, 0}}, {"nadir", json::object()}}},
                         {"sun", {{"direction", {1, 0, 0}}}}};
    if (!settings.detail.empty()) minimal_request["detail"] = settings.detail;
    const engine::FrameRequest surface = read_request(minimal_request, settings, assets, "verify moon");
    if (settings.center.empty()) {
      const auto rows = engine::discs_on_terrain(*renderer, surface, settings.size_px);
      report.discs.insert(report.discs.end(), rows.begin(), rows.end());
    } else {
      report.relief = relief_of(settings, *renderer, surface);
    }
    if (!settings.images.empty()) compare_images(settings, *renderer, assets, report);
  }
  const fs::path folder = settings.output;
  write_whole((folder / "disc.csv").string(), api::disc_csv(report));
  if (!report.relief.empty()) write_whole((folder / "relief.csv").string(), api::relief_csv(report));
  if (!report.images.empty()) write_whole((folder / "images.csv").string(), api::images_csv(report));
  const std::string page = api::moon_markdown(report);
  write_whole((folder / "moon.md").string(), page);
  write_json((folder / "moon.json").string(),
             {{"point_spread_px", report.point_spread_px}, {"beyond_bounds", api::bound_violations(report)}});
  fmt::print("{}", page);
  for (const std::string& what : api::bound_violations(report)) fmt::print("beyond its bound: {}\n", what);
  fmt::print("{0}: disc.csv, moon.md, moon.json; pictures: deploy/plot {0}\n", settings.output);
  return api::bound_violations(report).empty() ? 0 : 1;
}

}  // namespace selenograph::server
