// Lists of points as an .npz: a column of values becomes an array with a row for each point.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "api/encode/encode.h"
#include "dem/grid/geodesy.h"

namespace selenograph::api {

// Returns the type of a number's elements.
template <typename T>
constexpr ElementType element_type_of() {
  if constexpr (std::is_same_v<T, std::uint8_t>) return ElementType::uint8;
  if constexpr (std::is_same_v<T, std::uint16_t>) return ElementType::uint16;
  if constexpr (std::is_same_v<T, std::uint64_t>) return ElementType::uint64;
  if constexpr (std::is_same_v<T, float>) return ElementType::float32;
  if constexpr (std::is_same_v<T, double>) return ElementType::float64;
}

// Arrays of an .npz, one per column. Owns the elements to which the views point.
class ColumnArrays {
 public:
  // `shape`: of the arrays, with an element for each point; empty: n x 1. `flags`: type of flags, `boolean` or `uint8`.
  ColumnArrays(std::vector<std::size_t> shape, ElementType flags, const StopToken& stop)
      : shape_(std::move(shape)), flags_(flags), stop_(stop) {}

  // Adds an array of value(point): a flag, an integer, a double or a Vec3, which adds a last dimension of 3 (n x 3
  // without a shape).
  template <typename Points, typename Value>
  void add(const std::string& name, const Points& points, const Value& value) {
    using Result = std::decay_t<decltype(std::invoke(value, *points.begin()))>;
    constexpr bool kIsVector = std::is_same_v<Result, Vec3>;
    using Element =
        std::conditional_t<kIsVector, double, std::conditional_t<std::is_same_v<Result, bool>, std::uint8_t, Result>>;
    stop_.check();
    auto column = std::make_shared<std::vector<Element>>();
    column->reserve(points.size() * (kIsVector ? 3 : 1));
    for (const auto& point : points) {
      const Result result = std::invoke(value, point);
      if constexpr (kIsVector)
        column->insert(column->end(), result.begin(), result.end());
      else
        column->push_back(result);
    }
    std::vector<std::size_t> shape = shape_;
    if (kIsVector && !shape.empty()) shape.push_back(3);
    arrays_.push_back({names_.emplace_back(name),
                       std::is_same_v<Result, bool> ? flags_ : element_type_of<Element>(),
                       static_cast<int>(points.size()),
                       kIsVector ? 3 : 1,
                       1,
                       column->data(),
                       {},
                       std::move(shape)});
    columns_.push_back(std::move(column));
  }

  // Returns the archive. Throws Cancelled.
  std::string npz(const std::string& meta_json) const { return encode_npz(arrays_, meta_json, stop_); }

 private:
  const std::vector<std::size_t> shape_;
  const ElementType flags_;
  const StopToken& stop_;
  std::deque<std::string> names_;  // a deque, whose elements never move: views point to them
  std::vector<std::shared_ptr<const void>> columns_;
  std::vector<ArrayView> arrays_;
};

}  // namespace selenograph::api
