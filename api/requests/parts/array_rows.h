// Arrays of a request's .npz that replace JSON lists. They are read as rows of a few numbers:
//
//   shape (..., columns):   [x0 y0 z0] [x1 y1 z1] [x2 y2 z2] ...   all leading dimensions are flattened into one
#pragma once

#include <cstddef>
#include <initializer_list>
#include <optional>
#include <string>

#include "api/encode/read_npz.h"
#include "api/json/json_reader.h"

namespace selenograph::api {

// View of an array of shape (..., columns), which must outlive it. A single row is returned for every index: it is
// broadcast.
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

// Returns the array with this name; empty, and reported, if it is missing, has no rows, or has rows of another length.
std::optional<ArrayRows> rows_of(const NpzArrays& arrays, const std::string& name,
                                 std::initializer_list<std::size_t> columns, Findings& findings);

// Reports arrays that have none of the expected names.
void reject_unknown_arrays(const NpzArrays& arrays, std::initializer_list<std::string_view> expected,
                           Findings& findings);

}  // namespace selenograph::api
