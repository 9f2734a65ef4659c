// Writes numbers into tables.
#pragma once

#include <fmt/format.h>

#include <cmath>
#include <string>

namespace selenograph::api {

// Returns a number as text; empty for NaN, a missing value.
inline std::string cell(double number, const char* format = "{:.6g}") {
  return std::isnan(number) ? std::string() : fmt::format(fmt::runtime(format), number);
}

}  // namespace selenograph::api
