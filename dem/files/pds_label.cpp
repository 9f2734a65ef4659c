#include "dem/files/pds_label.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>

#include "dem/base/error.h"
#include "dem/base/names.h"
#include "dem/files/files.h"

namespace selenograph::dem {
namespace {

constexpr std::size_t kMaxLabel_bytes = 1 << 20;
constexpr int kMaxDepth = 32;

// Returns a text without blanks at its ends.
std::string_view trimmed(std::string_view s) {
  constexpr std::string_view blanks = " \t\r\n\f\v";
  const std::size_t from = s.find_first_not_of(blanks);
  if (from == std::string_view::npos) return {};
  return s.substr(from, s.find_last_not_of(blanks) - from + 1);
}

// Recursive-descent parser of ODL, the language of PDS3 labels: statements KEYWORD = VALUE, nested in OBJECT ..
// END_OBJECT. `at_` is the position of the next character.
class Parser {
 public:
  Parser(std::string_view text, const std::string& path) : text_(text), path_(path) {}

  PdsObject parse() {
    PdsObject label;
    fill(label, 0);
    if (!label.find("PDS_VERSION_ID")) throw DataError(path_, "is not a PDS3 label (PDS_VERSION_ID is missing)");
    return label;
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    const auto line = 1 + std::count(text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(at_), '\n');
    throw DataError(path_, "is not a valid PDS3 label: line " + std::to_string(line) + ": " + what);
  }

  bool done() const { return at_ >= text_.size(); }
  bool is_next(std::string_view s) const { return text_.substr(at_, s.size()) == s; }

  // Skips blanks and comments. A comment without its end "*/" ends with its line: PDS3 forbids longer ones.
  void skip_blanks() {
    while (!done()) {
      if (std::isspace(static_cast<unsigned char>(text_[at_]))) {
        ++at_;
      } else if (is_next("/*")) {
        const std::size_t line_end = std::min(text_.find('\n', at_), text_.size());
        const std::size_t close = text_.find("*/", at_ + 2);
        at_ = close < line_end ? close + 2 : line_end;
      } else {
        return;
      }
    }
  }

  // Reads a keyword. A byte that no keyword may have means that the file is no label.
  std::string_view keyword() {
    const std::size_t from = at_;
    while (!done() && text_[at_] != '=' && !std::isspace(static_cast<unsigned char>(text_[at_]))) {
      const char c = text_[at_];
      if (!std::isalnum(static_cast<unsigned char>(c)) && c != '_' && c != '^' && c != ':' && c != '-')
        fail("unexpected character in a keyword");
      ++at_;
    }
    if (at_ == from) fail("a keyword is missing");
    return text_.substr(from, at_ - from);
  }

  // Reads statements up to the end of this object, recursively for OBJECT and GROUP.
  void fill(PdsObject& object, int depth) {
    if (depth > kMaxDepth) fail("objects are nested too deeply");
    for (skip_blanks(); !done(); skip_blanks()) {
      const std::string_view key = keyword();
      if (same_text(key, "END")) {
        if (depth > 0) fail("END inside OBJECT " + object.name);
        return;
      }
      const bool closes = same_text(key, "END_OBJECT") || same_text(key, "END_GROUP");
      skip_same_line_blanks();
      const bool has_value = !done() && text_[at_] == '=';
      if (!has_value && !closes) fail("'=' is missing after " + std::string(key));
      PdsValue value;
      if (has_value) {
        ++at_;
        value = read_value();
      }
      if (closes) {
        if (depth == 0) fail(std::string(key) + " without its OBJECT");
        return;
      }
      if (same_text(key, "OBJECT") || same_text(key, "GROUP")) {
        PdsObject inner;
        inner.name = value.text();
        fill(inner, depth + 1);
        object.objects.push_back(std::move(inner));
      } else {
        object.values.emplace_back(std::string(key), std::move(value));
      }
    }
    if (depth > 0) fail("the label ends inside OBJECT " + object.name);
  }

  void skip_same_line_blanks() {
    while (!done() && (text_[at_] == ' ' || text_[at_] == '\t')) ++at_;
  }

  // Reads the value after '=', with its unit in < >.
  PdsValue read_value() {
    PdsValue value;
    skip_blanks();
    if (done()) fail("a value is missing");
    if (text_[at_] == '(' || text_[at_] == '{') {
      read_sequence(value);
    } else if (text_[at_] == '"' || text_[at_] == '\'') {
      value.items.push_back(quoted());
    } else {
      value.items.push_back(bare_line());
    }
    skip_same_line_blanks();
    if (!done() && text_[at_] == '<') value.unit = unit();
    return value;
  }

  std::string quoted() {
    const std::size_t close = text_.find(text_[at_], at_ + 1);
    if (close == std::string_view::npos) fail("a quoted text is not closed");
    const std::string out(trimmed(text_.substr(at_ + 1, close - at_ - 1)));
    at_ = close + 1;
    return out;
  }

  std::string unit() {
    const std::size_t close = text_.find('>', at_);
    if (close == std::string_view::npos) fail("a unit is not closed");
    const std::string out(trimmed(text_.substr(at_ + 1, close - at_ - 1)));
    at_ = close + 1;
    return out;
  }

  // Reads an unquoted value up to a unit, a comment or the end of the line. ISIS breaks long words with a hyphen at the
  // line's end.
  std::string bare_line() {
    std::string out;
    for (;;) {
      const std::size_t line_end = std::min(text_.find('\n', at_), text_.size());
      const std::string_view line = text_.substr(at_, line_end - at_);
      const std::size_t stop = std::min({line.find('<'), line.find("/*"), line.size()});
      out += trimmed(line.substr(0, stop));
      at_ += stop;
      if (stop < line.size() || out.empty() || out.back() != '-' || line_end == text_.size()) return out;
      out.pop_back();
      while (!done() && std::isspace(static_cast<unsigned char>(text_[at_]))) ++at_;
    }
  }

  // Reads ( ... ) or { ... }. Nested sequences are flattened: no reader needs their structure.
  void read_sequence(PdsValue& value) {
    int open = 0;  // brackets that are not closed yet
    do {
      skip_blanks();
      if (done()) fail("a sequence is not closed");
      const char c = text_[at_];
      if (c == '(' || c == '{') {
        if (++open > kMaxDepth) fail("sequences are nested too deeply");
        ++at_;
      } else if (c == ')' || c == '}') {
        --open;
        ++at_;
      } else if (c == ',') {
        ++at_;
      } else if (c == '<') {
        value.unit = unit();
      } else if (c == '"' || c == '\'') {
        value.items.push_back(quoted());
      } else {
        const std::size_t stop = std::min(text_.find_first_of(",(){}<\"\n", at_), text_.size());
        value.items.emplace_back(trimmed(text_.substr(at_, stop - at_)));
        at_ = stop;
      }
    } while (open > 0);
  }

  std::string_view text_;
  const std::string& path_;
  std::size_t at_ = 0;
};

}  // namespace

std::string upper_case(std::string_view s) {
  std::string out(s);
  std::transform(out.begin(), out.end(), out.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return out;
}

// Parses BASE#DIGITS#.
std::optional<std::uint64_t> parse_pds_based(std::string_view s) {
  const std::size_t hash = s.find('#');
  if (hash == std::string_view::npos || s.size() <= hash + 2 || s.back() != '#') return std::nullopt;
  int base = 0;
  std::uint64_t bits = 0;
  const std::string_view digits = s.substr(hash + 1, s.size() - hash - 2);
  std::from_chars(s.data(), s.data() + hash, base);
  if (base < 2 || base > 16) return std::nullopt;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), bits, base);
  if (error != std::errc() || end != digits.data() + digits.size()) return std::nullopt;
  return bits;
}

namespace {

std::optional<double> parse_number(std::string_view s) {
  if (!s.empty() && s.front() == '+') s.remove_prefix(1);
  if (const auto bits = parse_pds_based(s)) return static_cast<double>(*bits);
  std::string text(s);
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == 'D' || c == 'd'; }, 'e');  // Fortran's exponent
  double x = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), x);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(x)) return std::nullopt;
  return x;
}

}  // namespace

std::string PdsValue::text() const { return items.empty() ? std::string() : items.front(); }

std::optional<double> PdsValue::number(std::size_t i) const {
  return i < items.size() ? parse_number(items[i]) : std::nullopt;
}

const PdsValue* PdsObject::find(std::string_view keyword) const {
  for (const auto& [key, value] : values)
    if (same_text(key, keyword)) return &value;
  return nullptr;
}

const PdsValue* PdsObject::find_deep(std::string_view keyword) const {
  if (const PdsValue* here = find(keyword)) return here;
  for (const PdsObject& inner : objects)
    if (const PdsValue* inner_value = inner.find_deep(keyword)) return inner_value;
  return nullptr;
}

const PdsObject* PdsObject::find_object(std::string_view object_name) const {
  for (const PdsObject& inner : objects) {
    if (same_text(inner.name, object_name)) return &inner;
    if (const PdsObject* deeper = inner.find_object(object_name)) return deeper;
  }
  return nullptr;
}

PdsObject parse_pds_label(std::string_view text, const std::string& path) { return Parser(text, path).parse(); }

PdsObject read_pds_label(const std::string& path) { return parse_pds_label(read_head(path, kMaxLabel_bytes), path); }

bool begins_with_pds_label(const std::string& path) {
  constexpr std::size_t kHead_bytes = 256;  // the first keyword lies within these
  std::string head;
  try {
    head = read_head(path, kHead_bytes);
  } catch (const DataError&) {
    return false;
  }
  const std::string_view text = trimmed(head);
  // Accept CCSD...: the SFDU line that old archives put before the label.
  return text.starts_with("PDS_VERSION_ID") ||
         (text.starts_with("CCSD") && text.find("PDS_VERSION_ID") != std::string_view::npos);
}

std::vector<std::string> files_named_by(const PdsObject& label) {
  std::vector<std::string> names;
  for (const auto& [key, value] : label.values)
    if (key.starts_with('^')) names.push_back(lower(value.text()));
  return names;
}

bool describes_map(const PdsObject& label) {
  return label.find_object("IMAGE") && label.find_object("IMAGE_MAP_PROJECTION");
}

}  // namespace selenograph::dem
