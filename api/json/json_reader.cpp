#include "api/json/json_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace selenograph::api {
namespace {

constexpr std::size_t kMaxNameInError = 64;  // longer names are not repeated to the client

// Returns the key as part of a JSON Pointer (RFC 6901), with ~ and / escaped.
std::string escaped(std::string_view key) {
  std::string out;
  for (const char c : key) {
    if (c == '~') {
      out += "~0";
    } else if (c == '/') {
      out += "~1";
    } else {
      out += c;
    }
  }
  return out;
}

// "[json.exception.parse_error.101] parse error at ...: what" -> "parse error at ...: what".
std::string without_prefix(const std::string& what) {
  const std::size_t end = what.find("] ");
  return end == std::string::npos ? what : what.substr(end + 2, 300);
}

// Builds the document from the parser's events. Depth is limited before anything deeper is built, and a duplicate
// member is found before it replaces the first. (The library's own callback parser searches the whole parent after each
// object, which is quadratic in the size of the body.)
class Builder final : public nlohmann::json_sax<Json> {
 public:
  explicit Builder(int max_depth) : max_depth_(static_cast<std::size_t>(max_depth)) {}

  Json take() { return std::move(root_); }

  bool null() override { return add(nullptr); }
  bool boolean(bool value) override { return add(value); }
  bool number_integer(number_integer_t value) override { return add(value); }
  bool number_unsigned(number_unsigned_t value) override { return add(value); }
  bool number_float(number_float_t value, const string_t&) override { return add(value); }
  bool string(string_t& value) override { return add(std::move(value)); }
  bool binary(binary_t&) override { return false; }  // not in JSON text
  bool start_object(std::size_t) override { return open(Json::object()); }
  bool start_array(std::size_t) override { return open(Json::array()); }
  bool end_object() override { return close(); }
  bool end_array() override { return close(); }
  bool key(string_t& name) override {
    Level& level = levels_.back();
    level.key = std::move(name);
    if (!level.value->contains(level.key)) return true;
    throw RequestError("invalid_request", "a member is given twice", {{pointer(), "given twice"}});
  }
  bool parse_error(std::size_t, const std::string&, const Json::exception& e) override {
    if (e.id != kNumberOverflow) throw RequestError("malformed_json", without_prefix(e.what()));
    const char* what = "is beyond the range of double";
    throw RequestError("invalid_request", std::string("a number ") + what, {{pointer(), what}});
  }

 private:
  static constexpr int kNumberOverflow = 406;  // the library's json.exception.out_of_range.406
  // An open object or array on the path from the root to the value being parsed.
  struct Level {
    Json* value;
    std::string key;  // name of the current member, if the value is an object
  };

  // Stores a value in the innermost open object or array, or as the root, and returns its address.
  Json* store(Json&& value) {
    if (levels_.empty()) return &(root_ = std::move(value));
    Level& level = levels_.back();
    if (level.value->is_object()) return &((*level.value)[level.key] = std::move(value));
    level.value->push_back(std::move(value));
    return &level.value->back();
  }
  bool add(Json&& value) {
    store(std::move(value));
    return true;
  }
  bool open(Json&& value) {
    if (levels_.size() >= max_depth_) {
      const std::string what = fmt::format("nested deeper than {} levels", max_depth_);
      throw RequestError("malformed_json", what, {{pointer(), what}});
    }
    levels_.push_back({store(std::move(value)), {}});
    return true;
  }
  bool close() {
    levels_.pop_back();
    return true;
  }
  // Returns the JSON Pointer of the value that is parsed next, up to the first overlong name.
  std::string pointer() const {
    std::string out;
    for (std::size_t i = 0; i < levels_.size(); ++i) {
      const Level& level = levels_[i];
      if (level.value->is_object()) {
        if (level.key.size() > kMaxNameInError) return out;
        out += '/' + escaped(level.key);
      } else {
        // Outer arrays already hold the element that is being parsed; the innermost one does not.
        out += '/' + std::to_string(level.value->size() - (i + 1 < levels_.size() ? 1 : 0));
      }
    }
    return out;
  }

  std::size_t max_depth_;
  std::vector<Level> levels_;
  Json root_;
};

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

// Returns the Levenshtein distance, ignoring case. row[j] is the distance of the first i characters of `a` from the
// first j of `b`; `diagonal` is the entry to the left in the previous row.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (lower(a[i - 1]) == lower(b[j - 1]) ? 0 : 1);
      diagonal = std::exchange(row[j], std::min({replaced, row[j] + 1, row[j - 1] + 1}));
    }
  }
  return row.back();
}

// Returns "must be at least 1 and less than 3" for the range [1, 3).
std::string out_of_range_text(const Range& range) {
  const auto bound = [](double x) { return fmt::format("{}", x); };
  const bool has_min = range.min > std::numeric_limits<double>::lowest();
  const bool has_max = range.max < std::numeric_limits<double>::max();
  std::string what = "must be";
  if (has_min) what += (range.min_open ? " greater than " : " at least ") + bound(range.min);
  if (has_min && has_max) what += " and";
  if (has_max) what += (range.max_open ? " less than " : " at most ") + bound(range.max);
  return what;
}

// Returns `what`, followed by the known name nearest to `name` or, if none is near, by all known names.
std::string with_suggestion(const std::string& what, std::string_view name,
                            std::span<const std::string_view> known_names) {
  if (const auto nearest = did_you_mean(name, known_names))
    return what + "; did you mean \"" + std::string(*nearest) + "\"?";
  return what + "; known here: " + (known_names.empty() ? "none" : quoted_list(known_names, ", "));
}

}  // namespace

Json parse_json(std::string_view text, int max_depth) {
  Builder builder(max_depth);
  Json::sax_parse(text.begin(), text.end(), &builder);
  return builder.take();
}

std::string quoted_list(std::span<const std::string_view> names, std::string_view last_separator) {
  std::string out;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (i > 0) out += i + 1 == names.size() ? last_separator : ", ";
    out += '"' + std::string(names[i]) + '"';
  }
  return out;
}

std::optional<std::string_view> did_you_mean(std::string_view name, std::span<const std::string_view> known_names) {
  if (name.size() > kMaxNameInError) return std::nullopt;
  std::optional<std::string_view> nearest;
  // Allow two edits, since two swapped letters are two edits, but only one in names of up to three letters, where two
  // edits would reach almost any name.
  const std::size_t max_distance = name.size() < 4 ? 1 : std::max<std::size_t>(2, name.size() / 3);
  std::size_t min_distance = max_distance + 1;
  for (const std::string_view candidate : known_names) {
    const std::size_t distance = edit_distance(name, candidate);
    if (distance < min_distance) {
      min_distance = distance;
      nearest = candidate;
    }
  }
  return nearest;
}

std::string JsonReader::pointer() const {
  if (!parent_) return "";
  return parent_->pointer() + "/" + (parent_->value_->is_array() ? std::to_string(index_) : escaped(key_));
}

void JsonReader::fail(std::string detail) const { findings_->add(pointer(), std::move(detail)); }

void JsonReader::fail(std::string_view member, std::string detail) const {
  findings_->add(pointer() + "/" + escaped(member), std::move(detail));
}

bool JsonReader::object(std::span<const std::string_view> members) const {
  if (!value_->is_object()) {
    fail("must be an object");
    return false;
  }
  for (const auto& [name, value] : value_->items()) {
    if (findings_->full()) break;
    if (std::find(members.begin(), members.end(), name) != members.end()) continue;
    if (name.size() > kMaxNameInError) {
      fail("has an unknown member with a very long name");
    } else {
      fail(name, with_suggestion("unknown member", name, members));
    }
  }
  return true;
}

bool JsonReader::has(std::string_view name) const { return value_->is_object() && value_->contains(name); }

JsonReader JsonReader::at(std::string_view name) const { return JsonReader(value_->find(name).value(), this, name, 0); }

std::optional<double> JsonReader::number(const Range& range) const {
  const double x = value_->is_number() ? value_->get<double>() : 0.0;
  if (!value_->is_number()) {
    fail("must be a number");
  } else if (!std::isfinite(x)) {  // only in a document built by a program: parse_json rejects NaN and Infinity
    fail("must be finite");
  } else if (!range.contains(x)) {
    fail(out_of_range_text(range));
  } else {
    return x;
  }
  return std::nullopt;
}

double JsonReader::number(std::string_view name, const Range& range) const {
  if (has(name)) return at(name).number(range).value_or(0);
  if (value_->is_object()) fail(name, "is required");
  return 0;
}

double JsonReader::number(std::string_view name, const Range& range, double fallback) const {
  return has(name) ? at(name).number(range).value_or(fallback) : fallback;
}

std::optional<std::int64_t> JsonReader::integer(std::int64_t min, std::int64_t max) const {
  // Accept 1024.0: it is an integer in JSON Schema, and some languages write integers so.
  const double x = value_->is_number() ? value_->get<double>() : 0.5;
  if (x != std::floor(x)) {
    fail("must be an integer");
  } else if (x < static_cast<double>(min) || x > static_cast<double>(max)) {
    fail(fmt::format("must be at least {} and at most {}", min, max));
  } else {
    return static_cast<std::int64_t>(x);
  }
  return std::nullopt;
}

std::optional<bool> JsonReader::boolean() const {
  if (value_->is_boolean()) return value_->get<bool>();
  fail("must be true or false");
  return std::nullopt;
}

std::optional<std::string> JsonReader::text() const {
  if (value_->is_string()) return value_->get<std::string>();
  fail("must be a string");
  return std::nullopt;
}

std::optional<std::pair<double, double>> JsonReader::pair(const Range& first, const Range& second) const {
  std::vector<double> numbers;
  const std::size_t before = faults();
  elements(2, 2,
           [&](const JsonReader& x) { numbers.push_back(x.number(numbers.empty() ? first : second).value_or(0)); });
  if (faults() != before || numbers.size() != 2) return std::nullopt;
  return std::pair(numbers[0], numbers[1]);
}

std::optional<Vec3> JsonReader::vector(const Range& range) const {
  if (!value_->is_array() || value_->size() != 3) {
    fail("must be an array of three numbers");
    return std::nullopt;
  }
  const std::size_t before = faults();
  Vec3 v = Vec3::zero();
  int i = 0;
  elements(3, 3, [&](const JsonReader& element) { v[i++] = element.number(range).value_or(0); });
  return faults() == before ? std::optional(v) : std::nullopt;
}

bool JsonReader::array(std::size_t min, std::size_t max) const {
  if (!value_->is_array()) {
    fail("must be an array");
  } else if (value_->size() < min) {
    fail(fmt::format("must have at least {} element{}", min, min == 1 ? "" : "s"));
  } else if (value_->size() > max) {
    fail(fmt::format("must have at most {} elements, has {}", max, value_->size()));
  } else {
    return true;
  }
  return false;
}

void JsonReader::fail_word(std::string_view given_word, const std::vector<std::string_view>& words,
                           WordHints hints) const {
  const auto hint = std::find_if(hints.begin(), hints.end(), [&](const auto& h) { return h.first == given_word; });
  std::string advice;
  if (hint != hints.end())
    advice = "; " + std::string(hint->second);
  else if (const auto nearest = did_you_mean(given_word, words))
    advice = "; did you mean \"" + std::string(*nearest) + "\"?";
  fail("must be " + quoted_list(words, " or ") + advice);
}

std::optional<Vec3> direction_of(const Vec3& v) {
  if (is_unit(v)) return v;
  // Test for NaN first: maxCoeff may ignore it.
  const double largest = v.is_finite() ? v.max_abs() : 0;
  if (largest == 0) return std::nullopt;
  // Scale before the norm is computed: the squares of 1e300 and 1e-300 are not representable. Divide instead of
  // multiplying by the reciprocal, which is infinite for a subnormal.
  return Vec3(v.x() / largest, v.y() / largest, v.z() / largest).normalized();
}

std::optional<Vec3> direction_member(const JsonReader& in, const Vec3& v) {
  const std::optional<Vec3> direction = direction_of(v);
  if (!direction) in.fail("direction", "is zero: not a direction");
  return direction;
}

}  // namespace selenograph::api
