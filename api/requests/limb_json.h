// Requests for the Moon's limb and terminator in an image, and their answers as JSON and NPZ.
#pragma once

#include <string>
#include <vector>

#include "api/encode/negotiate.h"
#include "api/requests/parts/detail_json.h"
#include "api/schema/answers.h"
#include "engine/limb/limb_in_view.h"

namespace selenograph::api {

// A resolved request: the engine's request, and the detail by name.
struct LimbQuery {
  engine::LimbRequest request;
  Named<dem::Detail> detail{};  // null: none
};

const Members<LimbQuery>& limb_request_members();
// Parses a request. Throws RequestError("invalid_request") with the faults found.
LimbQuery read_limb(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop,
                    const GroundHeights& ground = {});

// Media types of the answer, in the order of the server's preference.
inline constexpr Alternative kLimbAnswers[] = {
    {"application/json", "the points, each with its members"},
    {"application/x-npz", "the same as arrays, NaN for null"},
};

// The answer's points, in order of azimuth.
struct LimbPoints {
  std::vector<engine::LimbPoint> points;
  std::vector<engine::TerminatorPoint> terminator;  // empty without a Sun
};
const Answer<engine::LimbPoint>& limb_answer();
const Answer<engine::TerminatorPoint>& terminator_answer();
OrderedJson limb_json(const LimbPoints& limb);
std::string limb_npz(const LimbPoints& limb, const StopToken& stop);

}  // namespace selenograph::api
