// The catalogue as the answer of GET /v1/datasets.
#pragma once

#include <string>

#include "api/schema/answers.h"
#include "dem/catalogue/catalogue.h"

namespace selenograph::api {

const Answer<dem::Catalogue>& datasets_answer();

// Returns the response as JSON text.
std::string datasets_text(const dem::Catalogue& catalogue);

}  // namespace selenograph::api
