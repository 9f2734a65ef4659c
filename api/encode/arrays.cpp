#include "api/encode/arrays.h"

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <string>

namespace selenograph::api {
namespace {

using engine::FrameProducts;

constexpr std::string_view kAxes[] = {"x", "y", "z"};
constexpr std::string_view kGeodetic[] = {"lat_deg", "lon_deg", "height_m"};
constexpr std::string_view kAngles[] = {"incidence_deg", "emission_deg", "phase_deg"};
constexpr std::string_view kLightSources[] = {"direct", "terrain", "earth"};
constexpr std::string_view kImageAxes[] = {"x", "y"};

// In each row: bit, name, array, components, whether it needs a Sun, meaning in frames (empty: maps only, after all
// others), and, for maps, order, unit and meaning.
constexpr ProductRow kTable[] = {
    {engine::kImage,
     "image",
     &FrameProducts::image,
     {},
     true,
     "digital numbers; 0, or a sensor's own offset and noise, where nothing is hit"},
    {engine::kRadiance,
     "radiance",
     &FrameProducts::radiance,
     {},
     true,
     "at-sensor radiance, W m-2 sr-1; 0 where nothing is hit",
     {1, "W m-2 sr-1",
      "radiance toward the viewer, W m-2 sr-1; also NaN where terrain hides the ground from the viewer"}},
    {engine::kDepth,
     "depth",
     &FrameProducts::depth,
     {},
     false,
     "distance along the boresight, m; NaN where nothing is hit"},
    {engine::kRange, "range", &FrameProducts::range, {}, false, "Euclidean distance, m; NaN where nothing is hit"},
    {engine::kPosition, "position", &FrameProducts::position, kAxes, false,
     "hit point in MOON_ME, m; NaN where nothing is hit"},
    {engine::kGeodetic, "geodetic", &FrameProducts::geodetic, kGeodetic, false,
     "lat_deg, lon_deg, height_m of the hit point; NaN where nothing is hit"},
    {engine::kNormal,
     "normal",
     &FrameProducts::normal,
     kAxes,
     false,
     "outward unit normal used for shading, MOON_ME; NaN where nothing is hit",
     {5, "", "outward unit normal used for shading, MOON_ME"}},
    {engine::kAngles, "angles", &FrameProducts::angles, kAngles, true,
     "incidence, emission, phase, degrees; NaN where nothing is hit"},
    {engine::kLit,
     "lit",
     &FrameProducts::lit,
     {},
     true,
     "lit fraction of the solar disc after self-shadowing; NaN where nothing is hit",
     {2, "", "lit fraction of the solar disc, self-shadowing included"}},
    {engine::kGsd,
     "gsd",
     &FrameProducts::gsd,
     {},
     false,
     "post spacing of the mesh that was hit, m; NaN where nothing is hit, or an object, a rock or its soil bank"},
    {engine::kSource,
     "source",
     &FrameProducts::source,
     {},
     false,
     "index into the frame's list of sources; 65535 where nothing is hit, or an object, a rock or its soil bank",
     {6, "", "index into the map's list of sources; 65535 for no data"}},
    {engine::kObjectId,
     "object_id",
     &FrameProducts::object_id,
     {},
     false,
     "index into the request's objects; 65535 where none is hit"},
    {engine::kDetail,
     "detail",
     &FrameProducts::detail,
     {},
     false,
     "kind of ground: 0 the DEM, including between its posts; 1 inside a crater of the request's detail; 2 its relief; "
     "3 a rock or a fragment; 4 a clod; 65535 where nothing is hit, or an object of the request"},
    {engine::kAlbedo,
     "albedo",
     &FrameProducts::albedo,
     {},
     false,
     "albedo of the ground as its reflectance has it: rho, w of `hapke`, or the ratio to the mean Moon of `moon`; by "
     "`albedo_maps` and, with detail, brighter around young craters. NaN where nothing is hit, or an object or a rock",
     {12, "",
      "albedo of the ground as its reflectance has it: rho, w of `hapke`, or the ratio to the mean Moon of "
      "`moon`"}},
    {engine::kIrradiance,
     "irradiance",
     &FrameProducts::irradiance,
     kLightSources,
     true,
     "irradiance of the ground, W m-2: from the Sun directly, from terrain, from the Earth; with an atmosphere times "
     "its transmittance to the sensor; NaN where nothing is hit",
     {7, "W m-2", "irradiance of the ground: from the Sun directly, from terrain, from the Earth"}},
    {engine::kFlow, "flow", &FrameProducts::flow, kImageAxes, false,
     "optical flow, px to the right and down: from the pixel to its point's position in the image at `flow_to`, also "
     "outside that image; NaN where nothing is hit, and where the point is hidden there, behind the camera, beyond a "
     "fold of the lens distortion or, with a shutter, seen by no row"},
    {engine::kHeight, "height", &FrameProducts::height, {}, false, "", {3, "m", "above the sphere of 1 737 400 m"}},
    {engine::kSlope,
     "slope",
     &FrameProducts::slope,
     {},
     false,
     "",
     {4, "degree",
      "angle between the sphere's vertical and the normal used for shading or, with `footprint`, the normal of the "
      "plane fitted to the ground in it"}},
    {engine::kRockHeight,
     "rock_height",
     &FrameProducts::rock_height,
     {},
     false,
     "",
     {8, "m", "height of a rock's surface above the ground without its soil bank; 0 without a rock. Requires `rocks`"}},
    {engine::kRockCover,
     "rock_cover",
     &FrameProducts::rock_cover,
     {},
     false,
     "",
     {9, "",
      "share of the footprint's pixels that show rocks: on average 0.59 of the circles of their `diameter_m`, since "
      "they "
      "are partly buried. Requires `rocks` and `footprint`"}},
    {engine::kRoughness,
     "roughness",
     &FrameProducts::roughness,
     {},
     false,
     "",
     {10, "m", "largest distance of ground in the footprint from the plane of `slope`. Requires `footprint`"}},
    {engine::kHazard,
     "hazard",
     &FrameProducts::hazard,
     {},
     false,
     "",
     {11, "",
      "sum of the limits of `hazard` that are exceeded: 1 slope, 2 roughness, 4 rock height, 8 rock cover; 0: "
      "none; 65535 for no data"}},
};

constexpr bool is_of_frames(const ProductRow& row) { return !row.meaning.empty(); }
constexpr std::size_t kFrameProductCount = std::ranges::count_if(kTable, is_of_frames);
static_assert(std::ranges::is_partitioned(kTable, is_of_frames), "products of maps alone come last");

// Returns the rows of products that maps have, in their own order and with their meaning in maps.
std::vector<ProductRow> rows_of_maps() {
  std::vector<ProductRow> rows;
  for (const ProductRow& row : kTable)
    if (row.in_maps.order > 0) {
      rows.push_back(row);
      rows.back().meaning = row.in_maps.meaning;
    }
  std::ranges::sort(rows, {}, [](const ProductRow& row) { return row.in_maps.order; });
  return rows;
}

const ProductRow& row_of(engine::Product product) {
  for (const ProductRow& row : kTable)
    if (row.product == product) return row;
  throw std::logic_error("unknown product");
}

ElementType type_of(const std::vector<std::uint8_t>&) { return ElementType::uint8; }
ElementType type_of(const std::vector<std::uint16_t>&) { return ElementType::uint16; }
ElementType type_of(const std::vector<Half>&) { return ElementType::float16; }
ElementType type_of(const std::vector<float>&) { return ElementType::float32; }
ElementType type_of(const std::vector<double>&) { return ElementType::float64; }

void narrow(double distance_m, float& narrowed) { narrowed = static_cast<float>(distance_m); }
// Rounds a double to half only once. Eigen rounds a float to half, so rounding to float first would round ties wrongly.
// Therefore round to odd: truncate to float and set the last bit if the float is inexact, which keeps it off every tie.
void narrow(double distance_m, Half& narrowed) {
  float to_odd = static_cast<float>(distance_m);
  if (std::isfinite(to_odd) && static_cast<double>(to_odd) != distance_m) {
    if (std::abs(static_cast<double>(to_odd)) > std::abs(distance_m)) to_odd = std::nextafter(to_odd, 0.F);
    to_odd = std::bit_cast<float>(std::bit_cast<std::uint32_t>(to_odd) | 1U);
  }
  narrowed = {Eigen::half_impl::float_to_half_rtne(to_odd).x};
}

// Returns a view of a product's elements; throws std::logic_error if there are not height x width of them.
template <typename Element>
ArrayView view(const ProductRow& row, const std::vector<Element>& data, int height, int width) {
  std::vector<std::string> channels = channel_names(row);
  const std::size_t expected = std::size_t(height) * std::size_t(width) * channels.size();
  if (data.size() != expected) {
    throw std::logic_error("there are " + std::to_string(data.size()) + " elements of " + std::string(row.name) +
                           ", not " + std::to_string(expected));
  }
  const auto count = int(channels.size());
  return {row.name, type_of(data), height, width, count, data.data(), std::move(channels)};
}

// Returns a view in the size of the image, or of the truth grid for products that it subsamples.
template <typename Element>
ArrayView view(const ProductRow& row, const std::vector<Element>& data, const engine::FrameRequest& request) {
  const bool is_subsampled = request.truth && row.product & engine::kTruth;
  return is_subsampled ? view(row, data, request.truth->rows(), request.truth->columns())
                       : view(row, data, request.camera.height, request.camera.width);
}

// Returns a view of a frame's product; one with a narrower type in the answer is converted into `narrowed` first.
ArrayView view_of(const ProductRow& row, const engine::Frame& frame, const engine::FrameRequest& request,
                  Narrowed& narrowed) {
  if (row.product == engine::kImage && image_bits(request) == 8) {
    const std::vector<std::uint16_t>& image = frame.products.image;
    narrowed.image.resize(image.size());
    std::transform(image.begin(), image.end(), narrowed.image.begin(),
                   [](std::uint16_t number) { return static_cast<std::uint8_t>(number); });
    return view(row, narrowed.image, request);
  }
  if (row.product == engine::kPosition && request.truth && request.truth->position_origin_m) {
    const std::vector<double>& position = frame.products.position;
    const Vec3& origin_m = *request.truth->position_origin_m;
    narrowed.position.resize(position.size());
    for (std::size_t i = 0; i < position.size(); ++i)
      narrowed.position[i] = static_cast<float>(position[i] - origin_m[static_cast<int>(i % 3)]);  // x, y, z
    return view(row, narrowed.position, request);
  }
  using Floats = engine::TruthGrid::Floats;
  const bool is_depth = row.product == engine::kDepth;
  if ((is_depth || row.product == engine::kRange) && request.truth && request.truth->distances != Floats::float64) {
    const std::vector<double>& distances_m = is_depth ? frame.products.depth : frame.products.range;
    const auto narrow_all = [&](auto& narrowed_distances) {
      narrowed_distances.resize(distances_m.size());
      for (std::size_t i = 0; i < distances_m.size(); ++i) narrow(distances_m[i], narrowed_distances[i]);
      return view(row, narrowed_distances, request);
    };
    if (request.truth->distances == Floats::float32) return narrow_all(is_depth ? narrowed.depth : narrowed.range);
    return narrow_all(is_depth ? narrowed.half_depth : narrowed.half_range);
  }
  return std::visit([&](const auto elements) { return view(row, frame.products.*elements, request); }, row.elements);
}

}  // namespace

std::span<const ProductRow> products() { return std::span(kTable).first(kFrameProductCount); }

std::span<const ProductRow> map_products() {
  static const std::vector<ProductRow> rows = rows_of_maps();
  return rows;
}

std::vector<std::string> channel_names(const ProductRow& row) {
  std::vector<std::string> names;
  for (const std::string_view component : row.components)
    names.push_back(std::string(row.name) + "." + std::string(component));
  if (names.empty()) names.emplace_back(row.name);
  return names;
}

std::string type_text(const ProductRow& row) {
  if (row.product == engine::kImage) return "uint8 or uint16";
  static constexpr std::string_view kTypes[] = {"uint16", "float32", "float64"};  // in the order of ProductElements
  return std::string(kTypes[row.elements.index()]) +
         (row.components.empty() ? "" : " x " + std::to_string(row.components.size()));
}

std::size_t bytes_per_pixel(engine::ProductSet products) {
  std::size_t sum = 0;
  for (const ProductRow& row : kTable) {
    if (!(products & row.product)) continue;
    sum += std::max<std::size_t>(row.components.size(), 1) *
           std::visit([](const auto elements) { return sizeof((FrameProducts().*elements)[0]); }, row.elements);
  }
  return sum;
}

std::string_view name_of(engine::Product product) { return row_of(product).name; }

std::vector<ArrayView> arrays_of(const engine::Frame& frame, const engine::FrameRequest& request,
                                 engine::ProductSet requested, Narrowed& narrowed) {
  std::vector<ArrayView> arrays;
  for (const ProductRow& row : products())
    if (requested & row.product) arrays.push_back(view_of(row, frame, request, narrowed));
  return arrays;
}

std::vector<ArrayView> map_arrays_of(const FrameProducts& products, engine::ProductSet requested, int height,
                                     int width) {
  std::vector<ArrayView> arrays;
  for (const ProductRow& row : map_products()) {
    if (!(requested & row.product)) continue;
    arrays.push_back(
        std::visit([&](const auto elements) { return view(row, products.*elements, height, width); }, row.elements));
  }
  return arrays;
}

}  // namespace selenograph::api
