// Answers with a map: its products as GeoTIFF, npz or PNG, metadata, and content hash.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "api/encode/encode.h"
#include "api/encode/negotiate.h"
#include "api/requests/map_json.h"

namespace selenograph::api {

// Media types of the answer, in the order of the server's preference.
inline constexpr Alternative kMapAnswers[] = {
    {"image/tiff",
     "GeoTIFF: a band for each product (three of normal), of the widest of their types; NoData is NaN, of source "
     "alone 65535; the metadata are the dataset's item SELENOGRAPH"},
    {"application/x-npz", "the products' arrays, and meta.json with the geotransform and WKT"},
    {"image/png",
     "one product except normal, 16 bit grey: 0 is no data, 1 to 65535 from the smallest to the largest value, of lit "
     "from 0 to 1, of radiance and slope from 0; `png_scale` in the metadata, the text chunk `selenograph`, says "
     "which. source is as it is"},
};

// Returns the memory of a map during its computation, without the scene cache, and of its answer.
std::size_t bytes_of(const engine::MapRequest& request);

// Returns 32 hexadecimal digits that identify the response's bytes and are known before rendering. `scene_bytes` is the
// memory for scenes, on which the division of a map into patches depends.
std::string content_hash(const MapQuery& query, std::size_t scene_bytes, std::uint64_t terrain_fingerprint,
                         std::string_view media_type);
OrderedJson metadata(const MapQuery& query, const engine::FrameReport& report, const std::string& hash);

// Returns the response's body with these metadata. Throws RequestError when a PNG cannot hold the products
// (check_map_answer checks this beforehand).
std::string encode_map(const MapQuery& query, const engine::Map& map, OrderedJson meta, std::string_view media_type,
                       const StopToken& stop = {});
// Throws RequestError if the media type cannot hold the products.
void check_map_answer(const MapQuery& query, std::string_view media_type);
// Returns true if a media type of kMapAnswers can hold the products.
bool holds_map(const MapQuery& query, std::string_view media_type);

}  // namespace selenograph::api
