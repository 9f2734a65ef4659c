// Order statistics.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace selenograph {

// Returns the value with index `rank` in ascending order. Partly sorts the vector.
template <typename T>
T ranked(std::vector<T>& values, std::size_t rank) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// Returns the median, for an even number of values the mean of the middle two. There must be at least one value.
inline double median(std::vector<double> values) {
  const std::size_t half = values.size() / 2;
  const double upper = ranked(values, half);
  if (values.size() % 2 == 1) return upper;
  return (upper + *std::max_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(half))) / 2;
}

}  // namespace selenograph
