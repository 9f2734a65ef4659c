// The API document. It is built from the tables that parse and dispatch requests, so that it cannot diverge from them.
#pragma once

#include <nlohmann/json.hpp>

#include "api/message/limits.h"

namespace selenograph::api {

// Returns the OpenAPI 3.1 document with examples and with the limits of this service.
nlohmann::ordered_json openapi_document(const Limits& limits);

}  // namespace selenograph::api
