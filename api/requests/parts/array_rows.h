// Arrays of a request's npz in the place of JSON lists: rows of a few numbers.
#pragma once

#include <cstddef>
#include <initializer_list>
#include <optional>
#include <string>

#include "api/encode/read_npz.h"
#include "api/json/json_reader.h"

namespace selenograph::api {

// An array of shape (..., columns); one row may stand for many.
class ArrayRows {
 public:
  explicit ArrayRows(const NpzArray& array) : array_(&array), columns_(array.shape.back()) {}
  std::size_t size() const { return array_->numbers.size() / columns_; }
  std::size_t columns() const { return columns_; }
  const double* row(std::size_t i) const { return &array_->numbers[columns_ * (size() == 1 ? 0 : i)]; }
  Vec3 vector(std::size_t i) const { return {row(i)[0], row(i)[1], row(i)[2]}; }

 private:
  const NpzArray* array_;
  std::size_t columns_;
};

// Reports an array that is missing, empty, or whose rows are not of one of these lengths.
std::optional<ArrayRows> rows_of(const NpzArrays& arrays, const std::string& name,
                                 std::initializer_list<std::size_t> columns, Findings& findings);

// Reports arrays with other names.
void refuse_other_arrays(const NpzArrays& arrays, std::initializer_list<std::string_view> known, Findings& findings);

}  // namespace selenograph::api
