// Places on the command line: "26.1,3.6".
#pragma once

#include <optional>
#include <string>

#include "dem/grid/geodesy.h"

namespace selenograph::server {

// Parses latitude and longitude in degrees; empty for invalid text.
std::optional<Geographic> place_of(const std::string& text);

}  // namespace selenograph::server
