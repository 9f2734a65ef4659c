// Answers with horizons and with the light above them: GeoTIFF, npz, JSON and CSV.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "api/encode/negotiate.h"
#include "api/requests/horizons_json.h"
#include "api/schema/answers.h"
#include "engine/horizons/illumination.h"

namespace selenograph::api {

// Media types of the answers, in the order of the server's preference. A GeoTIFF holds a map only, JSON and CSV hold
// places only.
inline constexpr Alternative kHorizonsAnswers[] = {
    {"image/tiff",
     "of a map: GeoTIFF of float32 degrees, a band for each azimuth; NaN: no data; the metadata are the dataset's item "
     "SELENOGRAPH"},
    {"application/json", "of places: the elevations, with the places"},
    {"application/x-npz",
     "`elevation_deg`: azimuths x height x width of a map, azimuths x places; `azimuth_deg`; meta.json"},
};
inline constexpr Alternative kIlluminationAnswers[] = {
    {"image/tiff",
     "of a map: GeoTIFF of float32, bands sun_mean, earth_mean, longest_night_h, nights, "
     "longest_without_earth_h; NaN: no data"},
    {"application/json", "of places: statistics and series of each"},
    {"application/x-npz",
     "the same as arrays: height x width of a map; of places the statistics, and `sun` and `earth` as epochs x places; "
     "meta.json"},
    {"text/csv", "of places: a line for each epoch, with the shares of Sun and Earth at each place"},
};
// Returns true if a media type can hold the answer.
bool holds(const HorizonsQuery& query, std::string_view media_type);

// Find the answer. `progress`: see HorizonProgress.
engine::HorizonElevations find(const HorizonsQuery& query, const engine::RenderContext& rendering,
                               const engine::HorizonProgress& progress = {});
// Without series if of a map.
engine::IlluminationSeries find(const IlluminationQuery& query, const engine::RenderContext& rendering,
                                const engine::HorizonProgress& progress = {});

// Return upper bounds of the memory for finding and encoding an answer.
std::size_t bytes_of(const HorizonsQuery& query);
std::size_t bytes_of(const IlluminationQuery& query);

std::string encode(const HorizonsQuery& query, const engine::HorizonElevations& found, std::string_view media_type,
                   const StopToken& stop);
// `found`: of a map without series.
std::string encode(const IlluminationQuery& query, const engine::IlluminationSeries& found, std::string_view media_type,
                   const StopToken& stop);

// Return the schemas of the JSON answers.
OrderedJson horizons_schema();
OrderedJson illumination_schema();

}  // namespace selenograph::api
