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
  const bool fits = !array.text && !array.shape.empty() &&
                    std::find(columns.begin(), columns.end(), array.shape.back()) != columns.end();
  if (fits && !array.numbers.empty()) return ArrayRows(array);
  if (fits) {
    findings.add("/" + name, "must have at least 1 row");
    return std::nullopt;
  }
  std::string shapes;
  for (const std::size_t n : columns) shapes += fmt::format("{}(n, {})", shapes.empty() ? "" : " or ", n);
  findings.add("/" + name, "must be numbers of shape " + shapes);
  return std::nullopt;
}

void refuse_other_arrays(const NpzArrays& arrays, std::initializer_list<std::string_view> known, Findings& findings) {
  for (const auto& [name, array] : arrays)
    if (std::find(known.begin(), known.end(), name) == known.end()) {
      std::string list = "request";
      for (const std::string_view one : known) list += fmt::format(", {}", one);
      findings.add("/" + name, "is not an array of this call, which takes " + list);
    }
}

}  // namespace selenograph::api
