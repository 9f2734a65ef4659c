// Places on the command line: "26.1,3.6".
#pragma once

#include <optional>
#include <string>

#include "dem/grid/geodesy.h"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace selenograph::server {

// Latitude and longitude in degrees; empty for anything else.
std::optional<Geographic> place_of(const std::string& text);

// An option that takes a place and refuses what is none.
CLI::Option* add_place(CLI::App& command, const std::string& name, std::string& text, const std::string& what);

}  // namespace selenograph::server
