// Lists of points as an .npz: a column of values becomes an array with a row for each point.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <type_traits>
#include <vector>

#include "api/encode/encode.h"
#include "dem/grid/geodesy.h"

namespace selenograph::api {

// Arrays of an .npz, one per column, with a row for each point. Owns the elements to which the views point.
class ColumnArrays {
 public:
  explicit ColumnArrays(const StopToken& stop) : stop_(stop) {}

  // Adds an array of value(point): a double (float64, n x 1), a Vec3 (float64, n x 3), or a flag or small number
  // (uint8, n x 1).
  template <typename Point, typename Value>
  void add(const std::string& name, const std::vector<Point>& points, const Value& value) {
    using Result = std::decay_t<std::invoke_result_t<const Value&, const Point&>>;
    stop_.check();
    if constexpr (std::is_integral_v<Result>) {
      std::vector<std::uint8_t>& column = bytes_.emplace_back();
      for (const Point& p : points) column.push_back(static_cast<std::uint8_t>(std::invoke(value, p)));
      add_view(name, ElementType::uint8, points.size(), 1, column.data());
    } else {
      std::vector<double>& column = numbers_.emplace_back();
      constexpr int kWidth = std::is_same_v<Result, Vec3> ? 3 : 1;
      for (const Point& p : points) {
        if constexpr (kWidth == 3) {
          const Vec3 v = std::invoke(value, p);
          column.insert(column.end(), v.begin(), v.end());
        } else {
          column.push_back(std::invoke(value, p));
        }
      }
      add_view(name, ElementType::float64, points.size(), kWidth, column.data());
    }
  }

  // Returns the archive. Throws Cancelled.
  std::string npz(const std::string& meta_json) const { return encode_npz(arrays_, meta_json, stop_); }

 private:
  void add_view(const std::string& name, ElementType type, std::size_t rows, int width, const void* data) {
    arrays_.push_back({names_.emplace_back(name), type, static_cast<int>(rows), width, 1, data, {}});
  }

  const StopToken& stop_;
  // Deques, whose elements never move: views point to them.
  std::deque<std::string> names_;
  std::deque<std::vector<double>> numbers_;
  std::deque<std::vector<std::uint8_t>> bytes_;
  std::vector<ArrayView> arrays_;
};

}  // namespace selenograph::api
