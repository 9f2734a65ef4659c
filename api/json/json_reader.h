// Converts untrusted JSON to checked values. All client input becomes typed values here and nowhere else.
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

// Type of input. Members are in a tree, so that look-up is fast for any body. (Output is ordered_json.)
using Json = nlohmann::json;

inline constexpr int kMaxJsonDepth = 16;  // nesting of a request

// Parses strict JSON (RFC 8259). Throws RequestError: "malformed_json" for text that is not JSON, NaN and Infinity
// included, and for nesting deeper than max_depth; "invalid_request" for a duplicate member and for numbers beyond the
// range of double.
Json parse_json(std::string_view text, int max_depth = kMaxJsonDepth);

// An interval of numbers: {0, 1}, closed, or with an open end above(0).to(1), from(0).below(1), above(0).below(1). The
// API document prints the same objects.
struct Range {
  double min = std::numeric_limits<double>::lowest();
  double max = std::numeric_limits<double>::max();
  bool min_open = false, max_open = false;
  constexpr Range to(double end) const { return {min, end, min_open, false}; }
  constexpr Range below(double end) const { return {min, end, min_open, true}; }
  bool contains(double x) const { return (min_open ? x > min : x >= min) && (max_open ? x < max : x <= max); }
};

constexpr Range from(double start) { return Range{start}; }
constexpr Range above(double start) { return {start, std::numeric_limits<double>::max(), true, false}; }

// Words of other tools that are rejected here, each with the text that tells the client what to write instead.
using WordHints = std::span<const std::pair<std::string_view, std::string_view>>;

// Table of words and their values.
template <typename T>
using Words = std::span<const std::pair<std::string_view, T>>;

// Returns the word for a value in such a table; empty if there is none.
template <typename Table, typename T>
constexpr std::string_view word_of(const Table& table, const T& value) {
  for (const auto& [word, meaning] : table)
    if (meaning == value) return word;
  return {};
}

// Returns the words of such a table.
template <typename Table>
std::vector<std::string_view> names_of(const Table& table) {
  std::vector<std::string_view> names;
  for (const auto& [word, meaning] : table) names.push_back(word);
  return names;
}

// Returns the names in quotation marks: "a", "b" or "c", for the last separator " or ".
std::string quoted_list(std::span<const std::string_view> names, std::string_view last_separator);

// Returns the known name closest to a misspelt one, if it is close enough.
std::optional<std::string_view> did_you_mean(std::string_view name, std::span<const std::string_view> known_names);

// A position in a JSON document. A reader of a member points to its parent's reader, which must outlive it: keep
// readers on the stack.
//
//   JsonReader(body)  <-parent-  at("camera")  <-parent-  at("fx")      pointer(): "/camera/fx"
//
// Faults are added to `findings` with their JSON Pointer, and a fallback is returned, so that one pass reports all
// faults. Callers check the findings before they compute with the values.
class JsonReader {
 public:
  JsonReader(const Json& root, Findings& findings) : value_(&root), findings_(&findings) {}

  // Returns the JSON Pointer (RFC 6901) from the root to this value.
  std::string pointer() const;
  const Json& value() const { return *value_; }
  // Returns true while the whole request has no faults.
  bool good() const { return findings_->empty(); }
  // Returns the number of faults found so far in the whole request.
  std::size_t faults() const { return findings_->count(); }
  // Reports a fault of this value.
  void fail(std::string detail) const;
  // Reports a fault of a member, present or not.
  void fail(std::string_view member, std::string detail) const;

  // Returns true for an object; reports a value that is not one, and each unknown member.
  bool object(std::span<const std::string_view> members) const;
  bool object(std::initializer_list<std::string_view> members) const {
    return object(std::span<const std::string_view>(members.begin(), members.size()));
  }
  bool has(std::string_view name) const;
  JsonReader at(std::string_view name) const;  // the member must exist; `name` must outlive the reader

  // Return the value; empty, and reported, if it has another type or is out of range.
  std::optional<double> number(const Range& range) const;
  std::optional<std::int64_t> integer(std::int64_t min, std::int64_t max) const;
  std::optional<bool> boolean() const;
  double number(std::string_view name, const Range& range) const;                   // required
  double number(std::string_view name, const Range& range, double fallback) const;  // optional
  std::optional<std::string> text() const;
  // Returns [a, b], each within its range; empty, and reported, for anything else.
  std::optional<std::pair<double, double>> pair(const Range& first, const Range& second) const;
  // Returns [x, y, z], each within range; empty, and reported, for anything else.
  std::optional<Vec3> vector(const Range& range) const;

  // Returns the word's value; empty, and reported, if the word is unknown.
  template <typename T>
  std::optional<T> word(Words<T> words, WordHints hints = {}) const {
    const std::optional<std::string> given_word = text();
    if (!given_word) return std::nullopt;
    for (const auto& [word, meaning] : words)
      if (word == *given_word) return meaning;
    fail_word(*given_word, names_of(words), hints);
    return std::nullopt;
  }

  // Calls each(reader) for the elements of an array of min to max elements; reports anything else without a call. Stops
  // when the findings are full.
  template <typename Each>
  void elements(std::size_t min, std::size_t max, Each&& each) const {
    if (!array(min, max)) return;
    for (std::size_t i = 0; i < value_->size() && !findings_->full(); ++i) each(JsonReader((*value_)[i], this, {}, i));
  }

 private:
  JsonReader(const Json& value, const JsonReader* parent, std::string_view key, std::size_t index)
      : value_(&value), findings_(parent->findings_), parent_(parent), key_(key), index_(index) {}
  // Returns true for an array of `min` to `max` elements; reports anything else.
  bool array(std::size_t min, std::size_t max) const;
  // Reports an unknown word, with its hint or the nearest of `words`.
  void fail_word(std::string_view given_word, const std::vector<std::string_view>& words, WordHints hints) const;

  const Json* value_;
  Findings* findings_;
  // Link to the parent, from which the JSON Pointer is composed only when there is a fault to report.
  const JsonReader* parent_ = nullptr;
  std::string_view key_;   // name of this member of an object
  std::size_t index_ = 0;  // index of this element of an array
};

// Returns true if a vector has unit length within rounding. Callers leave such a vector as it is: normalising twice
// would change the last bit, and a resolved request would no longer resolve to itself.
template <typename Vector>
bool is_unit(const Vector& v) {
  return std::abs(v.squared_norm() - 1) <= 8 * std::numeric_limits<double>::epsilon();
}

// Returns the unit vector of a vector of any length, also 1e-300 and 1e300; empty for zero, NaN and infinity.
std::optional<Vec3> direction_of(const Vec3& v);
// Returns the same of `v`, which was read from the member "direction" of `in`: a zero vector is reported there.
std::optional<Vec3> direction_member(const JsonReader& in, const Vec3& v);

}  // namespace selenograph::api
