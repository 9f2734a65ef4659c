// A round trip's figures as JSON and as text, and where its window lies: for POST /v1/verify/roundtrip and for
// `selenograph verify roundtrip`.
#pragma once

#include <string>

#include "api/requests/round_trip_json.h"
#include "api/schema/answers.h"
#include "dem/gdal/geotiff_writer.h"
#include "engine/verify/difference_statistics.h"

namespace selenograph::api {

struct RoundTripSource {
  const engine::RoundTripRequest& request;
  const engine::RoundTrip& trip;
  const engine::DifferenceStatistics& statistics;
};
const Answer<RoundTripSource>& round_trip_answer();

// A length with three digits in the unit that suits it: "0.0831 nm", "−1.27 mm", "8.16 m"; "none" for NaN.
std::string length_text(double length_m);

// Where the window's posts lie.
dem::GeotiffGrid grid_of(const engine::PostWindow& window);

}  // namespace selenograph::api
