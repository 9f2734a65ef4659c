#include "api/requests/parts/array_rows.h"

#include <fmt/format.h>

#include <algorithm>

namespace selenograph::api {

std::optional<ArrayRows> rows_of(const NpzArrays& arrays, const std::string& name,
                                 std::initializer_list<std::size_t> columns, Findings& findings) {
  const auto found = arrays.find(name);
  if (found == arrays.end()) {
    findings.add("/" + name, "this array is required");
    return std::nullopt;
  }
  const NpzArray& array = found->second;
  const bool has_rows_of_length = !array.text && !array.shape.empty() &&
                                  std::find(columns.begin(), columns.end(), array.shape.back()) != columns.end();
  if (has_rows_of_length && !array.numbers.empty()) return ArrayRows(array);
  if (has_rows_of_length) {
    findings.add("/" + name, "must have at least 1 row");
    return std::nullopt;
  }
  std::string shapes;
  for (const std::size_t n : columns) shapes += fmt::format("{}(n, {})", shapes.empty() ? "" : " or ", n);
  findings.add("/" + name, "must be numbers of shape " + shapes);
  return std::nullopt;
}

void reject_unknown_arrays(const NpzArrays& arrays, std::initializer_list<std::string_view> expected,
                           Findings& findings) {
  for (const auto& [name, array] : arrays)
    if (std::find(expected.begin(), expected.end(), name) == expected.end()) {
      std::string list = "request";
      for (const std::string_view expected_name : expected) list += fmt::format(", {}", expected_name);
      findings.add("/" + name, "is not an array of this call, which takes " + list);
    }
}

}  // namespace selenograph::api
