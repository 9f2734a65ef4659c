// `selenograph verify photographs`: compares photographs of the Moon with frames of the same views.
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "api/answers/photograph_report.h"
#include "api/encode/encode.h"
#include "api/encode/read_npz.h"
#include "api/message/problem.h"
#include "api/requests/frame_json.h"
#include "dem/base/library_messages.h"
#include "dem/files/files.h"
#include "dem/gdal/value_raster.h"
#include "engine/verify/photograph_measures.h"
#include "engine/verify/photograph_ties.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/request_file.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;
using engine::GreyImage;
using nlohmann::ordered_json;

constexpr const char* kRadianceUnit = "W m-2 sr-1 um-1";

// Members of a view. Those of the last line are what --fit writes for the reader; they are not read.
constexpr const char* kViewMembers[] = {"image",           "request",           "free", "unit", "tie_points",
                                        "residual_px_rms", "residual_px_median"};

// A photograph and the view that shows it.
struct Photograph {
  std::string name;
  GreyImage image;
  engine::FrameRequest request;
  engine::FreeParameters free;
  bool radiance = false;  // the image holds spectral radiance, W m-2 sr-1 um-1
};

std::runtime_error view_error(const std::string& name, const std::string& what) {
  return std::runtime_error(fmt::format("view {}: {}", name, what));
}

// Reads the mean of an image's bands, or an .npy of two dimensions.
GreyImage read_image(const fs::path& path) {
  if (path.extension() == ".npy") {
    api::NpzArray array = api::read_npy(dem::read_whole(path), path.string());
    if (array.shape.size() != 2 || array.shape[0] < 2 || array.shape[1] < 2 || array.numbers.size() > 1u << 28)
      throw std::runtime_error(path.string() + ": must have two dimensions: row, column");
    return {static_cast<int>(array.shape[1]), static_cast<int>(array.shape[0]), std::move(array.numbers)};
  }
  dem::ValueMapOptions options;
  options.path = path.string();
  options.extent = {-90, 90, -180, 180};  // a photograph has no place on the sphere; only its pixels are read
  const dem::ValueRaster raster(options);
  GreyImage out{raster.width(), raster.height(), {}};
  out.values.resize(static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height));
  raster.read(-1, {0, 0, out.width, out.height}, out.width, out.values.data());
  return out;
}

engine::FreeParameters read_free(const std::string& name, const ordered_json& view) {
  engine::FreeParameters out;
  const std::pair<const char*, bool*> parameters[] = {{"position", &out.position},
                                                      {"focal_length", &out.focal_length},
                                                      {"aspect", &out.aspect},
                                                      {"principal_point", &out.principal_point},
                                                      {"k1", &out.k1}};
  for (const auto& word : view.value("free", ordered_json{"position"})) {
    const auto found =
        std::find_if(std::begin(parameters), std::end(parameters), [&](const auto& k) { return word == k.first; });
    if (found == std::end(parameters))
      throw view_error(name, "\"free\" must list position, focal_length, aspect, principal_point, k1");
    *found->second = true;
  }
  return out;
}

// Reads a view's request with the products and the accuracy that the comparison needs.
engine::FrameRequest read_view_request(const std::string& name, nlohmann::json request, const api::Assets& assets) {
  request["products"] = {"radiance", "lit", "position"};
  if (!request.contains("accuracy")) request["accuracy"] = {{"samples_per_pixel", 16}, {"max_error_px", 0.25}};
  try {
    return api::read_frame(request, command_limits(), assets).request;
  } catch (const api::RequestError& e) {
    throw view_error(name, with_findings(e));
  }
}

Photograph read_photograph(const std::string& name, const ordered_json& view, const fs::path& folder,
                           const api::Assets& assets) {
  for (const auto& [member, unused] : view.items())
    if (std::find(std::begin(kViewMembers), std::end(kViewMembers), member) == std::end(kViewMembers))
      throw view_error(name, fmt::format("unknown member \"{}\"", member));
  if (!view.contains("image") || !view["image"].is_string() || !view.contains("request"))
    throw view_error(name, "needs \"image\", a file name, and \"request\", as for POST /v1/frames");
  const std::string unit = view.value("unit", "");
  if (!unit.empty() && unit != kRadianceUnit)
    throw view_error(name, fmt::format("\"unit\" must be \"{}\" or left out", kRadianceUnit));
  Photograph out{name, read_image(folder / view["image"].get<std::string>()),
                 read_view_request(name, view["request"], assets), read_free(name, view), !unit.empty()};
  if (out.radiance && !out.request.band) throw view_error(name, "a photograph with a unit needs a \"band\"");
  const engine::Camera& camera = out.request.camera;
  if (camera.width != out.image.width || camera.height != out.image.height)
    throw view_error(name, fmt::format("the camera has {} x {} pixels, the image {} x {}", camera.width, camera.height,
                                       out.image.width, out.image.height));
  if (!std::all_of(out.image.values.begin(), out.image.values.end(), [](double v) { return std::isfinite(v); }))
    throw view_error(name, "the image has pixels without a value");
  return out;
}

// The frame of a view as images, and what the report needs to know of its terrain.
struct Rendered {
  engine::Frame frame;
  engine::PhotographFrame images;
  double pixel_m;  // median distance on the ground of neighbouring pixels
};

GreyImage grey(const std::vector<float>& values, const engine::Camera& camera) {
  return {camera.width, camera.height, std::vector<double>(values.begin(), values.end())};
}

double pixel_size_m(const std::vector<double>& position, int width) {
  std::vector<double> sizes_m;
  for (std::size_t i = 1; 3 * i < position.size(); ++i) {
    if (i % static_cast<std::size_t>(width) == 0) continue;
    const double size_m = std::hypot(position[3 * i] - position[3 * i - 3], position[3 * i + 1] - position[3 * i - 2],
                                     position[3 * i + 2] - position[3 * i - 1]);
    if (std::isfinite(size_m)) sizes_m.push_back(size_m);
  }
  return engine::median_of(std::move(sizes_m));
}

// Renders the view. `photograph.radiance`: in the photograph's unit, W m-2 sr-1 um-1.
Rendered render_view(const Photograph& photograph, const engine::FrameRequest& request,
                     const engine::Renderer& renderer) {
  Rendered out{renderer.render(request), {}, 0};
  out.images = {grey(out.frame.products.radiance, request.camera), grey(out.frame.products.lit, request.camera),
                out.frame.products.position};
  if (photograph.radiance)
    for (double& value : out.images.radiance.values) value /= request.band->width_um();
  // `lit` is NaN where nothing is hit.
  for (double& value : out.images.lit.values) value = std::isfinite(value) ? value : 1;
  out.pixel_m = pixel_size_m(out.frame.products.position, request.camera.width);
  return out;
}

// Returns why a view cannot be compared on this terrain; empty if it can.
std::string missing_terrain(const Photograph& photograph, const Rendered& rendered) {
  constexpr double kMaxMissing = 0.1, kMaxPost_px = 4;
  const engine::FrameReport& report = rendered.frame.report;
  if (!(rendered.pixel_m > 0) || report.missing_fraction > kMaxMissing)
    return fmt::format("no terrain in {:.0f} % of the image", 100 * report.missing_fraction);
  const double post_px = report.min_post_spacing_m / rendered.pixel_m;
  // The mean radiance of a strip needs no resolved relief.
  if (post_px > kMaxPost_px && !photograph.radiance)
    return fmt::format("the finest posts there, {:.0f} m, are {:.1f} pixels wide; at most {:g} are compared",
                       report.min_post_spacing_m, post_px, kMaxPost_px);
  return {};
}

// Returns the Sun turned by 10 degrees toward the horizon of the image's middle, or away from it if it would set there.
// Turning it about the vertical instead would leave the lengths of shadows.
engine::Sun wrong_sun(const engine::FrameRequest& request, const std::vector<double>& position) {
  constexpr double kTurn_deg = 10;
  Vec3 up = Vec3::Zero();
  for (std::size_t i = 0; i + 2 < position.size(); i += 3)
    if (std::isfinite(position[i])) up += Vec3(position[i], position[i + 1], position[i + 2]).normalized();
  up.normalize();
  engine::Sun out = request.sun;
  const double elevation_deg = std::asin(std::clamp(up.dot(out.direction), -1.0, 1.0)) / kRadiansPerDegree;
  const double turn_rad = (elevation_deg > kTurn_deg ? kTurn_deg : -kTurn_deg) * kRadiansPerDegree;
  const Vec3 axis = up.cross(out.direction).normalized();
  out.direction = (Eigen::AngleAxisd(turn_rad, axis) * out.direction).normalized();
  return out;
}

// Ties nearer than this to their frame's position are searched for in a fitted view.
constexpr int kSearch_px = 6;

// Compares a photograph with a frame of the request.
api::PhotographComparison compare_with_frame(const Photograph& photograph, const engine::FrameRequest& request,
                                             const Rendered& rendered) {
  const auto ties = engine::find_ties(photograph.image, rendered.images.radiance, rendered.images.position, kSearch_px);
  return {engine::tie_distances_px({request.camera, request.pose}, ties, true),
          engine::compare_photograph(photograph.image, rendered.images)};
}

void write_png(const VerifyPhotographsSettings& s, const Photograph& photograph, const char* what, int width,
               int height, const std::vector<std::uint8_t>& pixels) {
  const api::ArrayView array{what, api::ElementType::uint8, height, width, 1, pixels.data(), {}};
  write_whole((fs::path(s.output) / fmt::format("{}.{}.png", photograph.name, what)).string(),
              api::encode_png(array, {}));
}

// Writes photograph, frame, difference and shadows as PNG. Values are scaled to 255 at the photograph's brightest
// thousandth; a difference of 0 is 128. Shadows: 0 in both, 85 only in the photograph, 170 only in the frame.
void write_panels(const VerifyPhotographsSettings& s, const Photograph& photograph,
                  const engine::PhotographMeasures& measures) {
  const GreyImage& image = photograph.image;
  std::vector<double> sorted = image.values;
  const auto bright = sorted.begin() + static_cast<std::ptrdiff_t>(0.999 * static_cast<double>(sorted.size()));
  std::nth_element(sorted.begin(), bright, sorted.end());
  const double scale = *bright > 0 ? 255 / *bright : 1;
  const auto byte = [](double value) { return static_cast<std::uint8_t>(std::clamp(std::round(value), 0.0, 255.0)); };
  std::vector<std::uint8_t> observed, frame, difference;
  for (std::size_t i = 0; i < image.values.size(); ++i) {
    const double a = scale * image.values[i], b = scale * measures.toned_frame.values[i];
    observed.push_back(byte(a));
    frame.push_back(byte(b));
    difference.push_back(byte(128 + a - b));
  }
  write_png(s, photograph, "photograph", image.width, image.height, observed);
  write_png(s, photograph, "frame", image.width, image.height, frame);
  write_png(s, photograph, "difference", image.width, image.height, difference);
  if (!measures.shadows) return;
  const engine::ShadowMasks& masks = measures.shadows->masks;
  std::vector<std::uint8_t> shadows;
  for (std::size_t i = 0; i < masks.photograph.size(); ++i)
    shadows.push_back(
        static_cast<std::uint8_t>(masks.photograph[i] ? (masks.frame[i] ? 0 : 85) : (masks.frame[i] ? 170 : 255)));
  write_png(s, photograph, "shadows", masks.width, masks.height, shadows);
}

// Writes a fitted view into its JSON.
void set_view(ordered_json& view, const engine::CameraView& fitted, const std::vector<double>& distances_px) {
  ordered_json& camera = view["request"]["camera"];
  camera.erase("fov_deg");
  camera["fx"] = fitted.camera.fx;
  camera["fy"] = fitted.camera.fy;
  camera["cx"] = fitted.camera.cx;
  camera["cy"] = fitted.camera.cy;
  if (fitted.camera.distortion.k1 != 0) camera["distortion"]["k1"] = fitted.camera.distortion.k1;
  const Vec3& position_m = fitted.pose.position_m;
  const Eigen::Matrix3d rotation = fitted.pose.camera_from_moon.toRotationMatrix();
  ordered_json rows = ordered_json::array();
  for (int row = 0; row < 3; ++row) rows.push_back({rotation(row, 0), rotation(row, 1), rotation(row, 2)});
  view["request"]["pose"] = {{"position_m", {position_m.x(), position_m.y(), position_m.z()}},
                             {"camera_from_moon_matrix", rows}};
  double squares = 0;
  for (const double distance : distances_px) squares += distance * distance;
  view["tie_points"] = distances_px.size();
  view["residual_px_rms"] = std::sqrt(squares / static_cast<double>(distances_px.size()));
  view["residual_px_median"] = engine::median_of(distances_px);
}

// Fits a view to its photograph: first the attitude alone with a wide search, then all free parameters.
void fit_view(Photograph photograph, ordered_json& view, const engine::Renderer& renderer) {
  constexpr int kRounds = 4;
  const int wide_px = std::max(kSearch_px, std::min(photograph.image.width, photograph.image.height) / 29);
  engine::FrameRequest& request = photograph.request;
  std::vector<engine::Tie> ties;
  for (int round = 0; round < kRounds; ++round) {
    const Rendered rendered = render_view(photograph, request, renderer);
    if (const std::string why = missing_terrain(photograph, rendered); !why.empty()) {
      fmt::print("{}: not fitted: {}\n", photograph.name, why);
      return;
    }
    ties = engine::find_ties(photograph.image, rendered.images.radiance, rendered.images.position,
                             round == 0 ? wide_px : kSearch_px);
    const engine::CameraView fitted = engine::fitted_view(
        {request.camera, request.pose}, round == 0 ? engine::FreeParameters{} : photograph.free, ties);
    request.camera = fitted.camera;
    request.pose = fitted.pose;
  }
  const engine::CameraView fitted{request.camera, request.pose};
  set_view(view, fitted, engine::tie_distances_px(fitted, ties, true));
  fmt::print("{}: {} ties held out, {:.3f} px RMS\n", photograph.name, view["tie_points"].get<std::size_t>(),
             view["residual_px_rms"].get<double>());
}

// Compares a photograph with its frame and with one of a wrong Sun, and adds both to the report.
void compare_photograph(const VerifyPhotographsSettings& s, const Photograph& photograph,
                        const engine::Renderer& renderer, api::PhotographReport& report) {
  const Rendered rendered = render_view(photograph, photograph.request, renderer);
  if (const std::string why = missing_terrain(photograph, rendered); !why.empty()) {
    report.skipped.push_back(photograph.name + ": " + why);
    return;
  }
  engine::FrameRequest control = photograph.request;
  control.sun = wrong_sun(control, rendered.frame.products.position);
  api::PhotographRow row{photograph.name,
                         rendered.pixel_m,
                         rendered.frame.report.min_post_spacing_m,
                         photograph.radiance,
                         compare_with_frame(photograph, photograph.request, rendered),
                         compare_with_frame(photograph, control, render_view(photograph, control, renderer))};
  write_panels(s, photograph, row.sun.measures);
  report.rows.push_back(std::move(row));
}

}  // namespace

int verify_photographs(const VerifyPhotographsSettings& s) {
  set_up_log(s.terrain.log_level);
  if (s.terrain.dem.empty()) throw std::runtime_error("verify photographs needs --dem: terrain where they were taken");
  const fs::path folder = s.images, views_path = s.views.empty() ? folder / "views.json" : fs::path(s.views);
  ordered_json views = ordered_json::parse(dem::read_whole(views_path), nullptr, false);
  if (!views.is_object() || views.empty())
    throw std::runtime_error(views_path.string() + ": must be a JSON object with a view per photograph");
  fs::create_directories(s.output);
  const auto renderer = make_renderer(s.terrain);
  const api::Assets assets(s.terrain.assets_dir);
  api::PhotographReport report;
  for (auto& [name, view] : views.items()) {
    const Photograph photograph = read_photograph(name, view, folder, assets);
    if (s.fit)
      fit_view(photograph, view, *renderer);
    else
      compare_photograph(s, photograph, *renderer, report);
  }
  const fs::path out = s.output;
  if (s.fit) {
    write_json((out / "views.json").string(), views);
    fmt::print("{}: views.json\n", s.output);
    return 0;
  }
  if (report.rows.empty())
    throw std::runtime_error("no photograph was compared: " + fmt::format("{}", fmt::join(report.skipped, "; ")));
  const std::string page = api::photographs_markdown(report);
  write_whole((out / "photographs.csv").string(), api::photographs_csv(report));
  write_whole((out / "photographs.md").string(), page);
  fmt::print("{}\n", page);
  const auto violations = api::bound_violations(report);
  for (const std::string& what : violations) fmt::print("beyond its bound: {}\n", what);
  fmt::print("{0}: photographs.csv, photographs.md, panels as PNG; pictures: deploy/plot {0}\n", s.output);
  return violations.empty() ? 0 : 1;
}

}  // namespace selenograph::server
