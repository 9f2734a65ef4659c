// Order statistics.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace selenograph {

// The value that `rank` others precede in ascending order; sorts the vector partly.
template <typename T>
T ranked(std::vector<T>& values, std::size_t rank) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// For an even number of values the mean of the middle two. There must be one.
inline double median(std::vector<double> values) {
  const std::size_t half = values.size() / 2;
  const double upper = ranked(values, half);
  if (values.size() % 2 == 1) return upper;
  return (upper + *std::max_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(half))) / 2;
}

}  // namespace selenograph
