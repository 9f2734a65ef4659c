// Results of a round trip as JSON and as text, and its window's grid: for POST /v1/verify/roundtrip and `selenograph
// verify roundtrip`.
#pragma once

#include <string>

#include "api/requests/round_trip_json.h"
#include "api/schema/answers.h"
#include "dem/gdal/geotiff_writer.h"
#include "engine/verify/difference_statistics.h"

namespace selenograph::api {

// Input of the answer.
struct RoundTripSource {
  const engine::RoundTripRequest& request;
  const engine::RoundTrip& trip;
  const engine::DifferenceStatistics& statistics;
};
const Answer<RoundTripSource>& round_trip_answer();

// Returns a length with three significant digits in a suitable unit: "0.0831 nm", "−1.27 mm", "8.16 m"; "none" for NaN.
std::string length_text(double length_m);

// Returns the grid of the window's posts.
dem::GeotiffGrid grid_of(const engine::PostWindow& window);

}  // namespace selenograph::api
