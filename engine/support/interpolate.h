// Tables with linear interpolation.
#pragma once

#include <algorithm>
#include <iterator>

namespace selenograph::engine {

// Two neighbouring entries of a table and the share of the way between them. Outside the table, the first or last two
// with a share below 0 or above 1.
template <typename Entry>
struct Segment {
  const Entry& a;
  const Entry& b;
  double share;
  double between(double from, double to) const { return from + share * (to - from); }
};

// Returns the segment around x of a table that increases by `key` and has at least two entries.
template <typename Table, typename Entry>
Segment<Entry> segment_at(const Table& table, double x, double Entry::*key) {
  const auto next = std::upper_bound(std::begin(table) + 1, std::end(table) - 1, x,
                                     [key](double y, const Entry& e) { return y < e.*key; });
  const Entry &a = *(next - 1), &b = *next;
  return {a, b, (x - a.*key) / (b.*key - a.*key)};
}

// Interpolates linearly in a table of at least one entry; constant beyond its ends.
template <typename Table, typename Entry>
double interpolated(const Table& table, double x, double Entry::*key, double Entry::*value) {
  const Entry &first = *std::begin(table), &last = *(std::end(table) - 1);
  if (x < first.*key) return first.*value;
  if (!(x < last.*key)) return last.*value;
  const Segment<Entry> s = segment_at(table, x, key);
  return s.between(s.a.*value, s.b.*value);
}

// Returns the integral of a product of two linear functions by Simpson's rule, which is exact.
inline double integral_of_product(double width, double a0, double a1, double b0, double b1) {
  return width / 6 * (a0 * b0 + (a0 + a1) * (b0 + b1) + a1 * b1);
}

}  // namespace selenograph::engine
