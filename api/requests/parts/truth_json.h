// "truth": engine::TruthGrid as JSON.
#pragma once

#include "api/requests/parts/camera_json.h"
#include "api/schema/members.h"
#include "engine/frame/camera.h"
#include "engine/frame/truth.h"

namespace selenograph::api {

// A region of width 0 is the whole image: resolve_truth() knows how large that is.
const Members<engine::TruthGrid>& truth_members();

// Sets the region, or reports that it exceeds the image; `in`: the frame's request.
void resolve_truth(const JsonReader& in, const engine::Camera& camera, engine::TruthGrid& truth);

}  // namespace selenograph::api
