// Places on the command line: "26.1,3.6" or "26:06N,3:36E", as GeographicLib reads them.
#pragma once

#include <optional>
#include <string>

#include "dem/grid/geodesy.h"

namespace selenograph::server {

// Parses latitude and longitude, in degrees or degrees, minutes and seconds; empty for invalid text.
std::optional<Geographic> place_of(const std::string& text);

}  // namespace selenograph::server
