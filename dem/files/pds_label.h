// PDS3 labels as text: PDS Standards Reference 3.8 (2009), chapter 12 (ODL).
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "dem/base/error.h"
#include "dem/files/files.h"

namespace selenograph::dem {

// Right-hand side of `KEYWORD = ...`. Quotes are removed; a sequence or set has several items.
struct PdsValue {
  std::vector<std::string> items;
  std::string unit;  // text between < and >, of the last item that has one

  std::string text() const;                               // the first item, or ""
  std::optional<double> number(std::size_t i = 0) const;  // empty for N/A and other words; 16#...# is understood
};

// OBJECT or GROUP, or the label itself. Keywords and names are compared without regard to case.
struct PdsObject {
  std::string name;
  std::vector<std::pair<std::string, PdsValue>> values;
  std::vector<PdsObject> objects;

  const PdsValue* find(std::string_view keyword) const;              // in this object only
  const PdsValue* find_deep(std::string_view keyword) const;         // here, else in the first inner object that has it
  const PdsObject* find_object(std::string_view object_name) const;  // depth first
};

// Parse a label, or the label at the beginning of a file. Both throw DataError naming `path` and, for bad syntax, the
// line. A text without PDS_VERSION_ID is not a label. Parsing stops at END: the pixels after an attached label are
// never parsed.
PdsObject parse_pds_label(std::string_view text, const std::string& path);
PdsObject read_pds_label(const std::string& path);

// Returns true if the file begins with a PDS3 label: a detached label, or an image with an attached one.
bool begins_with_pds_label(const std::string& path);
// Returns the names of the files that the label's pointers (^IMAGE and the like) give, in lower case.
std::vector<std::string> files_named_by(const PdsObject& label);
// Returns true if the label describes a map: it has an IMAGE and an IMAGE_MAP_PROJECTION.
bool describes_map(const PdsObject& label);

// Returns a text in upper case, for comparisons of keywords and names.
std::string upper_case(std::string_view s);

// Looks up keywords in an object and those within it; errors name the label.
class PdsReader {
 public:
  PdsReader(const PdsObject& object, const std::string& path) : object_(object), path_(path) {}

  std::optional<double> maybe(std::string_view keyword) const {
    const PdsValue* v = object_.find_deep(keyword);
    return v ? v->number() : std::nullopt;
  }
  // Returns a number, or `otherwise` if the keyword is missing or its text means no value. Throws DataError for another
  // text.
  double number_or(std::string_view keyword, double otherwise) const {
    if (const auto x = maybe(keyword)) return *x;
    const std::string text = word(keyword);
    if (text.empty() || text == "N/A" || text == "UNK" || text == "UNKNOWN" || text == "NULL") return otherwise;
    fail(std::string(keyword) + " is not a number: '" + text + "'");
  }
  double number(std::string_view keyword) const {
    if (const auto x = maybe(keyword)) return *x;
    throw DataError(path_, std::string(keyword) + " is missing or not a number");
  }
  int count(std::string_view keyword) const {
    const double x = number(keyword);
    if (x >= 1 && x <= 1e9 && x == std::floor(x)) return static_cast<int>(x);
    throw DataError(path_, std::string(keyword) + " must be a positive whole number");
  }
  std::string word(std::string_view keyword) const {
    const PdsValue* v = object_.find_deep(keyword);
    return v ? upper_case(v->text()) : std::string();
  }
  const PdsValue* value(std::string_view keyword) const { return object_.find_deep(keyword); }
  const std::string& path() const { return path_; }
  [[noreturn]] void fail(const std::string& what) const { throw DataError(path_, what); }
  // Throws NotHeights: the label does not describe heights.
  [[noreturn]] void no_heights(const std::string& what) const { throw NotHeights(path_, what); }

 private:
  const PdsObject& object_;
  const std::string& path_;
};

// Parses a whole number in another base, such as 16#FF7FFFFB#.
std::optional<std::uint64_t> parse_pds_based(std::string_view s);

}  // namespace selenograph::dem
