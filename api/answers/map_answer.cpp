#include "api/answers/map_answer.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "api/answers/eclipse.h"
#include "api/answers/metadata.h"
#include "api/answers/metadata_members.h"
#include "api/encode/arrays.h"
#include "api/message/json_text.h"
#include "api/message/version.h"
#include "api/requests/parts/detail_json.h"
#include "dem/gdal/geotiff_writer.h"
#include "engine/hazard/hazard_map.h"

namespace selenograph::api {
namespace {

// Calls visit(row, elements) for each requested product.
template <typename Visit>
void for_each_product(const MapQuery& query, const engine::FrameProducts& products, const Visit& visit) {
  for (const ProductRow& row : map_products())
    if (query.request.products & row.product)
      std::visit([&](const auto elements) { visit(row, products.*elements); }, row.elements);
}

// Returns a GeoTIFF band for each channel of the requested products. The channels of a pixel are adjacent in memory, so
// a band's values are `channel_count` elements apart.
std::vector<dem::MapBand> bands_of(const MapQuery& query, const engine::FrameProducts& products) {
  std::vector<dem::MapBand> bands;
  for_each_product(query, products, [&](const ProductRow& row, const auto& values) {
    const std::vector<std::string> names = channel_names(row);
    const int channel_count = static_cast<int>(names.size());
    for (int i = 0; i < channel_count; ++i)
      bands.push_back(
          {names[static_cast<std::size_t>(i)], std::string(row.in_maps.unit), values.data() + i, channel_count});
  });
  return bands;
}

// Linear scale of a PNG: values of the digital numbers 1 and 65535; 0 is no data.
struct Scale {
  double low, high;
};

// Returns the scale of a product: fixed for `lit`, from the smallest value for heights, from 0 for all others.

template <typename Element>
Scale scale_of(const ProductRow& row, const std::vector<Element>& values) {
  if (row.product == engine::kLit) return {0, 1};
  Scale scale{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (const Element element : values) {
    const auto value = static_cast<double>(element);
    if (std::isnan(value)) continue;
    scale.low = std::min(scale.low, value);
    scale.high = std::max(scale.high, value);
  }
  if (row.product != engine::kHeight) scale.low = 0;
  // Give the scale a positive width where all values are equal, or none is finite.
  if (!(scale.high > scale.low)) scale.high = std::isfinite(scale.low) ? scale.low + 1 : 1;
  if (!std::isfinite(scale.low)) scale.low = 0;
  return scale;
}

std::string encode_map_png(const MapQuery& query, const engine::FrameProducts& products, OrderedJson meta,
                           const StopToken& stop) {
  const dem::MapGrid& grid = query.request.grid;
  std::string png;
  const auto encode = [&](const ProductRow& row, const std::vector<std::uint16_t>& numbers) {
    const ArrayView view{row.name, ElementType::uint16, grid.height, grid.width, 1, numbers.data(), {}};
    png = encode_png(view, {{"selenograph", json_ascii(meta)}}, stop);
  };
  // check_map_answer() has ensured that exactly one product is requested. One of uint16 is written as it is, without a
  // scale.
  for_each_product(query, products, [&]<typename Element>(const ProductRow& row, const std::vector<Element>& values) {
    if constexpr (std::is_same_v<Element, std::uint16_t>) {
      encode(row, values);
    } else {
      const Scale scale = scale_of(row, values);
      meta["png_scale"] = {{"value_of_1", scale.low}, {"value_of_65535", scale.high}, {"no_data", 0}};
      std::vector<std::uint16_t> numbers(values.size());
      std::transform(values.begin(), values.end(), numbers.begin(), [&](Element element) {
        const auto value = static_cast<double>(element);
        if (std::isnan(value)) return std::uint16_t{0};
        const double share = std::clamp((value - scale.low) / (scale.high - scale.low), 0.0, 1.0);
        return static_cast<std::uint16_t>(1 + std::lround(65534 * share));
      });
      encode(row, numbers);
    }
  });
  return png;
}

}  // namespace

std::size_t bytes_of(const engine::MapRequest& request) {
  // A map with a footprint is drawn with a margin, and possibly with more products than are in the answer.
  const bool has_margin = engine::wants_footprint(request);
  const engine::MapRequest drawn = has_margin ? engine::request_with_margin(request) : request;
  const std::size_t pixels = static_cast<std::size_t>(drawn.grid.width) * static_cast<std::size_t>(drawn.grid.height);
  std::size_t arrays = 0;
  std::vector<dem::MapBand> bands;
  for (const ProductRow& row : map_products()) {
    if (!((request.products | drawn.products) & row.product)) continue;
    std::visit(
        [&](const auto elements) {
          using Elements = std::remove_cvref_t<decltype(engine::FrameProducts().*elements)>;
          const std::size_t components = std::max<std::size_t>(row.components.size(), 1);
          arrays += components * pixels * sizeof(typename Elements::value_type);
          const typename Elements::value_type* no_values = nullptr;  // only the element's type counts here
          bands.insert(bands.end(), components, {"", "", no_values});
        },
        row.elements);
  }
  // A patch has 512 x 512 pixels, each with its direction and a frame's arrays: 96 bytes. The answer is encoded while
  // the arrays exist, and a GeoTIFF's bytes are copied once.
  constexpr std::size_t kPatchBytes = std::size_t{512} * 512 * 96;
  return arrays + (has_margin ? engine::bytes_of_footprints(request, drawn) : 0) +
         2 * std::max(arrays, dem::geotiff_bytes_at_most(request.grid, bands)) + kPatchBytes;
}

std::string content_hash(const MapQuery& query, std::size_t scene_bytes, std::uint64_t terrain_fingerprint,
                         std::string_view media_type) {
  OrderedJson hashed{{"map_request", resolved_json(query)},
                     {"terrain", terrain_fingerprint},
                     {"maps", maps_metadata(query.request.scenery, query.surface)},
                     {"scene_bytes", scene_bytes},
                     {"version", software_version()},
                     {"representation", media_type}};
  if (const auto& detail = query.request.scenery.detail) hashed["detail"] = detail_metadata(query.detail, *detail);
  if (query.map_error) {
    hashed["map_error"] = map_error_metadata(*query.map_error);
    for (const dem::MapError::Field& field : query.map_error->error.height)
      if (field.layer.content) hashed["layers"].push_back(field.layer.content->fingerprint());
  }
  if (const double share = sun_covered(query); share > 0) hashed[kSunCovered] = share;
  return content_hash(json_text(hashed));
}

OrderedJson metadata(const MapQuery& query, const engine::FrameReport& report, const std::string& hash) {
  OrderedJson warnings = report.warnings;
  warn_of_relaxed_targets(query.scenery().accuracy, report, warnings);
  if (query.request.products & engine::kRadiance)
    add_reflectance_warnings(query.scenery(), query.surface, report, warnings);
  warn_of_band(query.scenery(), warnings);
  const double covered_share = sun_covered(query);
  warn_of_eclipse(covered_share, kSunCovered, warnings);
  if (report.hit_fraction == 0) warnings.push_back("there is no data anywhere in the map");
  const double narrower_m =
      std::min(query.area.width_m.value_or(query.area.gsd_m), query.area.height_m.value_or(query.area.gsd_m));
  if (narrower_m < query.area.gsd_m)
    warnings.push_back(
        fmt::format("a side of the map is {:g} m, less than gsd_m: it is one pixel; lengths are metres", narrower_m));
  if (query.map_error) warn_of_map_error(*query.map_error, query.scenery().detail != nullptr, warnings);
  if (query.request.rocks) warn_of_no_rocks(*query.scenery().detail, warnings);
  return metadata_answer().write({.request = query.scenery(),
                                  .products = query.request.products,
                                  .scenery = query,
                                  .report = report,
                                  .hash = hash,
                                  .resolved = resolved_json(query),
                                  .warnings = std::move(warnings),
                                  .sun_covered = covered_share,
                                  .frame = nullptr,
                                  .map = &query});
}

bool holds_map(const MapQuery& query, std::string_view media_type) {
  const engine::ProductSet products = query.request.products;
  return media_type != "image/png" || (std::has_single_bit(products) && products != engine::kNormal);
}

void check_map_answer(const MapQuery& query, std::string_view media_type) {
  if (holds_map(query, media_type)) return;
  const std::string what = "image/png holds exactly one product, and not normal";
  throw RequestError("invalid_request", what, {{"/products", what + "; image/tiff and application/x-npz hold all"}});
}

std::string encode_map(const MapQuery& query, const engine::Map& map, OrderedJson meta, std::string_view media_type,
                       const StopToken& stop) {
  check_map_answer(query, media_type);
  if (media_type == "image/png") return encode_map_png(query, map.products, std::move(meta), stop);
  if (media_type == "application/x-npz")
    return encode_npz(
        map_arrays_of(map.products, query.request.products, query.request.grid.height, query.request.grid.width),
        json_text(meta, 2), stop);
  return dem::geotiff_bytes(query.request.grid, bands_of(query, map.products), json_ascii(meta), stop);
}

}  // namespace selenograph::api
