// The API document, built from the tables that the parser and the dispatcher use, so that they cannot diverge.
#pragma once

#include <nlohmann/json.hpp>

#include "api/message/limits.h"

namespace selenograph::api {

// OpenAPI 3.1 with examples and with the limits of this service.
nlohmann::ordered_json openapi_document(const Limits& limits);

}  // namespace selenograph::api
