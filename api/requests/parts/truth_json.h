// "truth": the subset of pixels for which ground truth is given, engine::TruthGrid.
//
//   image    . . . . . . . .      region: x = 1, y = 1, width = 6, height = 4; every_px = 2
//            . # . # . # . .      truth arrays: 2 x 3 elements, at the pixels #
//            . . . . . . . .
//            . # . # . # . .
//            . . . . . . . .
#pragma once

#include "api/requests/parts/camera_json.h"
#include "api/schema/members.h"
#include "engine/frame/camera.h"
#include "engine/frame/truth.h"

namespace selenograph::api {

// A TruthGrid of width 0 is the whole image: resolve_truth() sets its size from the camera's.
const Members<engine::TruthGrid>& truth_members();

// Sets the region to the whole image if the frame's request `in` has none; reports a region that exceeds the image.
void resolve_truth(const JsonReader& in, const engine::Camera& camera, engine::TruthGrid& truth);

}  // namespace selenograph::api
