// Requests for the Moon's limb in an image, and their answers as JSON and NPZ.
#pragma once

#include <string>
#include <vector>

#include "api/encode/negotiate.h"
#include "api/requests/parts/detail_json.h"
#include "api/schema/answers.h"
#include "engine/frame/limb.h"

namespace selenograph::api {

struct LimbQuery {
  engine::LimbRequest request;
  Named<dem::Detail> detail{};  // null: none
};

const Members<LimbQuery>& limb_request_members();
// Throws RequestError("invalid_request") with the faults found.
LimbQuery read_limb(const Json& body, const Limits& limits, const Assets& assets = Assets(),
                    const StopToken& stop = {});

// In the order of the server's preference.
inline constexpr Alternative kLimbAnswers[] = {
    {"application/json", "the points, each with its members"},
    {"application/x-npz", "the same as arrays, NaN for null"},
};

const Answer<engine::LimbPoint>& limb_answer();
OrderedJson limb_json(const std::vector<engine::LimbPoint>& points);
std::string limb_npz(const std::vector<engine::LimbPoint>& points, const StopToken& stop);

}  // namespace selenograph::api
