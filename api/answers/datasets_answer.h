// The catalogue, as GET /v1/datasets says it.
#pragma once

#include <string>

#include "api/schema/answers.h"
#include "dem/catalogue/catalogue.h"

namespace selenograph::api {

const Answer<dem::Catalogue>& datasets_answer();

// The answer's text.
std::string datasets_text(const dem::Catalogue& catalogue);

}  // namespace selenograph::api
