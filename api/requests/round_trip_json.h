// A round trip's request and its figures as JSON: for POST /v1/verify/roundtrip and for `selenograph verify roundtrip`.
#pragma once

#include <nlohmann/json.hpp>
#include <string_view>

#include "api/schema/members.h"
#include "api/service.h"
#include "dem/gdal/geotiff_writer.h"
#include "engine/verify/difference_statistics.h"

namespace selenograph::api {

// Name and mode, for error messages, files and titles.
inline constexpr std::pair<std::string_view, engine::RoundTripMode> kRoundTripModes[] = {
    {"exact", engine::RoundTripMode::exact}, {"camera", engine::RoundTripMode::camera}};
std::string_view mode_name(engine::RoundTripMode mode);

// Posts along the side of a request's window: as many posts as rays are allowed.
int most_posts(const Limits& limits);
int default_posts(const Limits& limits);

const Members<engine::RoundTripRequest>& round_trip_members();
// Throws RequestError.
engine::RoundTripRequest read_round_trip(const Json& body, const Limits& limits);

nlohmann::ordered_json round_trip_json(const engine::RoundTripRequest& request, const engine::RoundTrip& trip,
                                       const engine::DifferenceStatistics& statistics);

// A length with three digits in the unit that suits it: "0.0831 nm", "−1.27 mm", "8.16 m"; "none" for NaN.
std::string length_text(double length_m);

// Where the window's posts lie.
dem::GeotiffGrid grid_of(const engine::PostWindow& window);

}  // namespace selenograph::api
