// Untrusted JSON -> checked values. Everything that a client sends crosses into typed values here and nowhere else.
#pragma once

#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "api/message/problem.h"
#include "dem/grid/geodesy.h"

namespace selenograph::api {

// What comes in: members in a tree, so that no body makes looking them up slow. (What goes out is ordered_json.)
using Json = nlohmann::json;

// Parses strict JSON (RFC 8259). Throws RequestError: "malformed_json" for what is not JSON, NaN and Infinity included,
// and for nesting deeper than max_depth; "invalid_request" for a member given twice and for numbers beyond the range of
// double.
Json parse_json(std::string_view text, int max_depth);

// An interval of numbers, closed unless said otherwise. The API document prints the same objects.
struct Range {
  double min = std::numeric_limits<double>::lowest();
  double max = std::numeric_limits<double>::max();
  bool min_open = false, max_open = false;
  bool contains(double x) const { return (min_open ? x > min : x >= min) && (max_open ? x < max : x <= max); }
};

// Words that a member may hold and what they mean inside.
template <typename T>
using Words = std::span<const std::pair<std::string_view, T>>;

// The word for a value in a table like those; empty for a value that has none.
template <typename Table, typename T>
constexpr std::string_view word_of(const Table& table, const T& value) {
  for (const auto& [word, meaning] : table)
    if (meaning == value) return word;
  return {};
}

// "a", "b" or "c".
std::string quoted_list(std::span<const std::string_view> names, std::string_view last_separator);

// The name nearest to a misspelt one, if one is near enough to be meant.
std::optional<std::string_view> did_you_mean(std::string_view name, std::span<const std::string_view> known);

// A place in a JSON document. Readers of members hold a pointer to their parent's reader, which must outlive them: keep
// them on the stack. Faults are added to `findings` with the JSON Pointer of the place, and a fallback is answered, so
// that one pass reports all of them; callers check findings before they compute with the values.
class JsonReader {
 public:
  JsonReader(const Json& root, Findings& findings) : value_(&root), findings_(&findings) {}

  std::string pointer() const;
  const Json& value() const { return *value_; }
  bool good() const { return findings_->empty(); }
  // Found so far, of this reader and all others of the request.
  std::size_t faults() const { return findings_->seen(); }
  void fail(std::string detail) const;
  // About a member, present or not.
  void fail(std::string_view member, std::string detail) const;

  // True for an object; reports when it is none and each member that is not one of these.
  bool object(std::span<const std::string_view> members) const;
  bool object(std::initializer_list<std::string_view> members) const {
    return object(std::span<const std::string_view>(members.begin(), members.size()));
  }
  bool has(std::string_view name) const;
  JsonReader at(std::string_view name) const;  // must have it; `name` must outlive the reader

  // Of members that exclude each other: the one given. Two are an error that names both, as is none when `required`.
  // Answers "" then.
  std::string_view alternative(std::span<const std::string_view> names, bool required) const;
  std::string_view alternative(std::initializer_list<std::string_view> names, bool required) const {
    return alternative(std::span<const std::string_view>(names.begin(), names.size()), required);
  }

  // The value itself; nothing where it is none, or out of range, which is reported.
  std::optional<double> number(const Range& range) const;
  std::optional<std::int64_t> integer(std::int64_t min, std::int64_t max) const;
  std::optional<bool> boolean() const;
  double number(std::string_view name, const Range& range) const;                   // required
  double number(std::string_view name, const Range& range, double fallback) const;  // optional
  std::optional<std::string> text() const;
  // [a, b], each within its range; empty, and reported, when it isn't two numbers.
  std::optional<std::pair<double, double>> pair(const Range& first, const Range& second) const;
  // [x, y, z], each within range.
  Vec3 vector(const Range& range) const;

  // The word's meaning; nothing when it is no such word, which is reported.
  template <typename T>
  std::optional<T> word(Words<T> words) const {
    std::vector<std::string_view> names;
    for (const auto& [name, meaning] : words) names.push_back(name);
    const int found = word_index(names);
    return found < 0 ? std::nullopt : std::optional<T>(words[static_cast<std::size_t>(found)].second);
  }

  // Calls each(reader) for the elements of an array of min..max elements; reports and calls nothing otherwise.
  template <typename Each>
  void elements(std::size_t min, std::size_t max, Each&& each) const {
    if (!array(min, max)) return;
    for (std::size_t i = 0; i < value_->size() && !findings_->full(); ++i) each(JsonReader((*value_)[i], this, {}, i));
  }

 private:
  JsonReader(const Json& value, const JsonReader* parent, std::string_view key, std::size_t index)
      : value_(&value), findings_(parent->findings_), parent_(parent), key_(key), index_(index) {}
  bool array(std::size_t min, std::size_t max) const;
  int word_index(const std::vector<std::string_view>& names) const;

  const Json* value_;
  Findings* findings_;
  // The pointer is put together only when there is something to report: most requests are right.
  const JsonReader* parent_ = nullptr;
  std::string_view key_;
  std::size_t index_ = 0;
};

// Whether a vector is of unit length but for the rounding of having been normalised before. Then it is kept as it is:
// doing it twice would move the last bit, and a resolved request would no longer resolve to itself.
template <typename Vector>
bool is_unit(const Vector& v) {
  return std::abs(v.squaredNorm() - 1) <= 8 * std::numeric_limits<double>::epsilon();
}

// A vector's direction whatever its length (1e-300 and 1e300 alike); empty for zero.
std::optional<Vec3> direction_of(const Vec3& v);

}  // namespace selenograph::api
