// A number in a table.
#pragma once

#include <fmt/format.h>

#include <cmath>
#include <string>

namespace selenograph::api {

// Empty where there is none (NaN).
inline std::string cell(double number, const char* format = "{:.6g}") {
  return std::isnan(number) ? std::string() : fmt::format(fmt::runtime(format), number);
}

}  // namespace selenograph::api
