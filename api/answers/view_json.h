// Describes a frame's view in terms of the ground, and diagnoses a view that shows no ground.
#pragma once

#include <nlohmann/json.hpp>

#include "api/requests/frame_json.h"
#include "api/schema/answers.h"
#include "dem/catalogue/catalogue.h"
#include "engine/frame/report.h"

namespace selenograph::api {

// Input of the metadata's member "view".
struct ViewSource {
  const FrameQuery& query;
  const engine::ViewReport& view;
};
const Answer<ViewSource>& view_answer();

// Adds a warning when the lens images less than half of the image.
void add_lens_warning(const engine::Camera& camera, nlohmann::ordered_json& warnings);

// Adds warnings when a frame shows no Moon, mostly ground without data, posts many pixels wide, or sky where the
// inverse attitude would see ground. They name the common mistake that would explain it: an inverted attitude, another
// order of the quaternion's components, OpenGL axes, swapped latitude and longitude, lengths that are not in metres.
void add_view_warnings(const FrameQuery& query, const engine::FrameReport& report, const dem::Catalogue& catalogue,
                       nlohmann::ordered_json& warnings);

}  // namespace selenograph::api
