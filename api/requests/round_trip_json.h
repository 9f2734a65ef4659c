// A round trip's request as JSON: for POST /v1/verify/roundtrip and for `selenograph verify roundtrip`.
#pragma once

#include <string_view>

#include "api/message/limits.h"
#include "api/schema/members.h"
#include "engine/verify/difference_statistics.h"

namespace selenograph::api {

// Modes by name, for requests, error messages, files and titles.
inline constexpr std::pair<std::string_view, engine::RoundTripMode> kRoundTripModes[] = {
    {"exact", engine::RoundTripMode::exact}, {"camera", engine::RoundTripMode::camera}};
std::string_view mode_name(engine::RoundTripMode mode);

// Returns the largest number of posts along a side of the window: one ray goes through each post, and rays are limited.
std::int64_t max_posts(const Limits& limits);
int default_posts(const Limits& limits);

const Members<engine::RoundTripRequest>& round_trip_members();
// Parses a request. Throws RequestError("invalid_request") with the faults found.
engine::RoundTripRequest read_round_trip(const Json& body, const Limits& limits);

}  // namespace selenograph::api
