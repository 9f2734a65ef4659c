// Version of this software: api/versions.md says what it covers.
#pragma once

#include <string_view>

namespace selenograph::api {

// Returns "MAJOR.MINOR.PATCH".
std::string_view software_version();

}  // namespace selenograph::api
