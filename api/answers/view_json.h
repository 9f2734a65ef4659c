// What a frame's view is in words of the ground, and what is probably wrong with a view that shows nothing of it.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "api/requests/frame_json.h"
#include "api/schema/answers.h"
#include "dem/catalogue/catalogue.h"
#include "engine/frame/report.h"

namespace selenograph::api {

// `meta.view`.
struct ViewSource {
  const FrameQuery& query;
  const engine::ViewReport& view;
};
const Answer<ViewSource>& view_answer();

// ", where the Sun stands ..."; empty where the boresight meets no terrain.
std::string sun_there(const engine::ViewReport& view);

// A frame that sees nothing, or hardly any data, or posts as large as tiles, is rarely what was meant. Says what is
// seen, and which usual mistake would explain it: an attitude that is the inverse of what was meant, has its scalar
// part elsewhere or OpenGL's axes; latitude and longitude in each other's place; lengths that are not metres.
void add_view_warnings(const FrameQuery& query, const engine::FrameReport& report, const dem::Catalogue& catalogue,
                       nlohmann::ordered_json& warnings);

}  // namespace selenograph::api
