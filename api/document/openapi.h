// The API document, built from the tables that the parser and the dispatcher use, so that they can't drift apart.
#pragma once

#include <nlohmann/json.hpp>

#include "api/message/limits.h"

namespace selenograph::api {

// OpenAPI 3.1 with examples; limits are those of this service.
nlohmann::ordered_json openapi_document(const Limits& limits);

// Its parts: component schemas, and what calls take and answer.
nlohmann::ordered_json openapi_schemas(const Limits& limits);
nlohmann::ordered_json openapi_paths();
void add_feature_answers(nlohmann::ordered_json& schemas);

// Requests that work: shown in the document, sent by tests. By call: "nadir", "landing_site".
nlohmann::ordered_json frame_examples();
nlohmann::ordered_json map_examples();

}  // namespace selenograph::api
