#include "dem/files/pds_label.h"

#include <algorithm>
#include <bit>
#include <cctype>
#include <charconv>
#include <cmath>
#include <filesystem>

#include "dem/files/files.h"
#include "dem/grid/geodesy.h"
#include "dem/support/error.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLongestLabel = 1 << 20;
constexpr int kDeepestObject = 32;
constexpr std::uint64_t kFarthestByte = 1'000'000'000'000'000;  // of a file: what is added to it stays within 64 bits

char upper(char c) { return static_cast<char>(std::toupper(static_cast<unsigned char>(c))); }

std::string upper(std::string_view s) {
  std::string out(s);
  std::transform(out.begin(), out.end(), out.begin(), [](char c) { return upper(c); });
  return out;
}

bool same_word(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](char x, char y) { return upper(x) == upper(y); });
}

std::string_view trimmed(std::string_view s) {
  constexpr std::string_view blanks = " \t\r\n\f\v";
  const std::size_t from = s.find_first_not_of(blanks);
  if (from == std::string_view::npos) return {};
  return s.substr(from, s.find_last_not_of(blanks) - from + 1);
}

// ---- ODL text ------------------------------------------------------------------------------------------------------

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
  bool looking_at(std::string_view s) const { return text_.substr(at_, s.size()) == s; }

  // Past blanks and comments. A comment that its author forgot to close ends with its line (PDS3 forbids longer ones).
  void skip_blanks() {
    while (!done()) {
      if (std::isspace(static_cast<unsigned char>(text_[at_]))) {
        ++at_;
      } else if (looking_at("/*")) {
        const std::size_t line_end = std::min(text_.find('\n', at_), text_.size());
        const std::size_t close = text_.find("*/", at_ + 2);
        at_ = close < line_end ? close + 2 : line_end;
      } else {
        return;
      }
    }
  }

  // `KEYWORD`, without what follows. Bytes that can't be in one mean that this is no label at all.
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

  // Statements up to the end of this object; recursion follows OBJECT and GROUP.
  void fill(PdsObject& object, int depth) {
    if (depth > kDeepestObject) fail("objects are nested too deeply");
    for (skip_blanks(); !done(); skip_blanks()) {
      const std::string_view key = keyword();
      if (same_word(key, "END")) {
        if (depth > 0) fail("END inside OBJECT " + object.name);
        return;
      }
      const bool closes = same_word(key, "END_OBJECT") || same_word(key, "END_GROUP");
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
      if (same_word(key, "OBJECT") || same_word(key, "GROUP")) {
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

  // Unquoted, up to a unit, a comment or the end of the line; ISIS breaks long words with a hyphen at the line's end.
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

  // ( ... ) or { ... }; nested ones are flattened, nobody needs their shape here.
  void read_sequence(PdsValue& value) {
    int open = 0;
    do {
      skip_blanks();
      if (done()) fail("a sequence is not closed");
      const char c = text_[at_];
      if (c == '(' || c == '{') {
        if (++open > kDeepestObject) fail("sequences are nested too deeply");
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

// 16#FF7FFFFB#: a whole number in another base.
std::optional<std::uint64_t> parse_based(std::string_view s) {
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

std::optional<double> parse_number(std::string_view s) {
  if (!s.empty() && s.front() == '+') s.remove_prefix(1);
  if (const auto bits = parse_based(s)) return static_cast<double>(*bits);
  double x = 0;
  const auto [end, error] = std::from_chars(s.data(), s.data() + s.size(), x);
  if (error != std::errc() || end != s.data() + s.size() || !std::isfinite(x)) return std::nullopt;
  return x;
}

// ---- what the label means ------------------------------------------------------------------------------------------

// Looks up members and complains in the label's name.
class Reader {
 public:
  Reader(const PdsObject& object, const std::string& path) : object_(object), path_(path) {}

  std::optional<double> maybe(std::string_view keyword) const {
    const PdsValue* v = object_.find_deep(keyword);
    return v ? v->number() : std::nullopt;
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
    return v ? upper(v->text()) : std::string();
  }
  const PdsValue* value(std::string_view keyword) const { return object_.find_deep(keyword); }
  [[noreturn]] void fail(const std::string& what) const { throw DataError(path_, what); }
  // It is about something else.
  [[noreturn]] void no_heights(const std::string& what) const { throw NotHeights(path_, what); }

 private:
  const PdsObject& object_;
  const std::string& path_;
};

// SAMPLE_TYPE names of the PDS Standards Reference, appendix C. Plain INTEGER, REAL and the like are MSB (Sun, Mac,
// IEEE).
PdsSample sample_type(const Reader& image) {
  const std::string type = image.word("SAMPLE_TYPE");
  const int bits = image.count("SAMPLE_BITS");
  PdsSample s;
  s.bytes = bits / 8;
  s.real = type.find("REAL") != std::string::npos || type == "FLOAT";
  s.has_sign = type.find("UNSIGNED") == std::string::npos;
  s.little_endian = type.starts_with("LSB_") || type.starts_with("PC_") || type.starts_with("VAX_");
  const bool integer = type.ends_with("INTEGER");
  if (integer && bits == 8) image.no_heights("samples of 8 bits are not heights");
  const bool vax_real = type.starts_with("VAX") && s.real;
  const bool known_size = s.real ? bits == 32 || bits == 64 : bits == 16 || bits == 32;
  if ((!integer && !s.real) || vax_real || !known_size)
    image.fail("samples of type '" + type + "' with " + std::to_string(bits) + " bits are not supported");
  return s;
}

double unit_in_metres(const Reader& image) {
  const std::string unit = image.word("UNIT");
  if (unit.empty() || unit == "N/A" || unit == "M" || unit.starts_with("MET")) return 1;
  if (unit == "KM" || unit.starts_with("KILOMET")) return 1000;
  image.no_heights("is not about heights: its UNIT is '" + unit + "'");
}

// A bit pattern such as 16#FF7FFFFB# stands for the real number with those bits.
double void_of(const std::string& text, const PdsSample& sample, double number) {
  const auto bits = sample.real ? parse_based(text) : std::nullopt;
  if (!bits) return number;
  return sample.bytes == 4 ? static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(*bits)))
                           : std::bit_cast<double>(*bits);
}

std::vector<double> void_values(const Reader& image, const PdsSample& sample) {
  std::vector<double> voids;
  for (const char* keyword : {"DUMMY", "MISSING_CONSTANT", "MISSING", "INVALID_CONSTANT", "NOT_APPLICABLE_CONSTANT",
                              "NULL", "CORE_NULL", "INVALID_VALUE"}) {
    const PdsValue* v = image.value(keyword);
    for (std::size_t i = 0; v && i < v->items.size(); ++i)
      if (const auto x = v->number(i)) voids.push_back(void_of(v->items[i], sample, *x));
  }
  return voids;
}

// The label's folder, the name it gives, and failing that the same name in another case (archives differ, labels
// don't).
fs::path find_data_file(const std::string& label_path, const std::string& name) {
  const fs::path folder = fs::path(label_path).parent_path();
  const fs::path wanted = folder / fs::path(name).filename();
  std::error_code error;
  if (fs::is_regular_file(wanted, error)) return wanted;
  for (const auto& entry : fs::directory_iterator(folder.empty() ? fs::path(".") : folder, error))
    if (same_word(entry.path().filename().string(), wanted.filename().string()))
      return folder / entry.path().filename();
  if (is_system_fault(error.value())) throw SystemFault(folder.string(), error.value());
  throw DataError(label_path, "its data file " + wanted.filename().string() + " is missing");
}

// ^IMAGE = "FILE" | ("FILE", record) | ("FILE", n <BYTES>) | record | n <BYTES>; records and bytes count from 1.
void find_pixels(const Reader& label, const std::string& label_path, PdsImage& out) {
  const PdsValue* pointer = label.value("^IMAGE");
  if (!pointer || pointer->items.empty()) label.fail("^IMAGE is missing");
  const bool attached = pointer->number(0).has_value();
  out.data_path = attached ? label_path : find_data_file(label_path, pointer->text()).string();
  const std::size_t place = attached ? 0 : 1;
  if (place >= pointer->items.size()) return;
  const auto start = pointer->number(place);
  if (!start || *start < 1 || *start > kFarthestByte || *start != std::floor(*start))
    label.fail("^IMAGE has no valid position");
  const auto before = static_cast<std::uint64_t>(*start) - 1;
  const bool bytes = upper(pointer->unit).starts_with("BYTE");
  const auto record = static_cast<std::uint64_t>(bytes || before == 0 ? 1 : label.count("RECORD_BYTES"));
  if (before > kFarthestByte / record) label.fail("^IMAGE has no valid position");
  out.first_byte = before * record;
}

void check_data_size(const std::string& label_path, const PdsImage& image) {
  std::error_code error;
  const std::uint64_t have = fs::file_size(image.data_path, error);
  if (error && is_system_fault(error.value())) throw SystemFault(image.data_path, error.value());
  if (error) throw DataError(label_path, "its data file " + image.data_path + " can't be read: " + error.message());
  const std::uint64_t rows = static_cast<std::uint64_t>(image.height) - 1;
  const std::uint64_t last = static_cast<std::uint64_t>(image.width) * static_cast<std::uint64_t>(image.sample.bytes);
  const std::uint64_t need = image.first_byte + rows * image.row_bytes + last;
  if (have < need)
    throw DataError(label_path, "its data file " + fs::path(image.data_path).filename().string() +
                                    " is truncated: it has " + std::to_string(have) + " bytes, the label asks for " +
                                    std::to_string(need));
}

// Metres per pixel. The PDS data dictionary's default unit is km/pixel.
std::optional<double> map_scale_m(const Reader& map) {
  const PdsValue* v = map.value("MAP_SCALE");
  if (!v || !v->number()) return std::nullopt;
  const std::string unit = upper(v->unit);
  if (unit.starts_with("DEG")) return *v->number() * kMetresPerDegree;
  return *v->number() * (unit.starts_with("M") ? 1 : 1000);
}

// MAP_RESOLUTION first: MAP_SCALE is printed rounded. A scale alone is brought back to the whole number it came from.
double posts_per_degree(const Reader& map) {
  double ppd = map.maybe("MAP_RESOLUTION").value_or(0);
  if (ppd <= 0) {
    const auto scale = map_scale_m(map);
    if (!scale || *scale <= 0) map.fail("MAP_RESOLUTION and MAP_SCALE are both missing");
    ppd = kMetresPerDegree / *scale;
    if (std::abs(ppd / std::round(ppd) - 1) < 5e-5) ppd = std::round(ppd);  // a scale of five digits
  }
  if (!(ppd > 1e-3 && ppd < 1e9)) map.fail("MAP_RESOLUTION is impossible");
  return ppd;
}

// One axis of a cylindrical map, in posts from the projection's centre, growing with the row or column number.
struct Axis {
  int count = 0;
  std::optional<double> offset;       // LINE_ or SAMPLE_PROJECTION_OFFSET
  std::optional<double> first, last;  // from the corners that the label prints
  double period = 0;                  // of a longitude, else 0
};

// Where the first post lies. The corners that the label prints say which of the conventions in use is meant by the
// offset, which is the more exact number:
// - corners at the outermost posts (Kaguya) span count - 1, at the outer pixel edges (LOLA) they span count;
// - offsets count from the first post's position (Kaguya, LOLA) or from one post before it (1-based, older products),
// and
//   early Kaguya products have the opposite sign.
// A Kaguya label with edges printed is still recognised, as its offset then equals the edge.
std::optional<double> first_post(const Axis& a) {
  const auto near = [&](double x, double y, double tolerance) {
    const double d = a.period > 0 ? std::remainder(x - y, a.period) : x - y;
    return std::abs(d) < tolerance;
  };
  std::vector<double> candidates;
  if (a.offset) candidates = {-*a.offset, 1 - *a.offset, *a.offset, *a.offset - 1};
  if (!a.first || !a.last) return a.offset ? std::optional(-*a.offset) : std::nullopt;

  // The conventions differ by half a post at least; printed decimals are off by much less than the tolerances here.
  const double span = *a.last - *a.first;
  std::vector<double> targets;
  if (std::abs(span - (a.count - 1)) < 0.3) targets = {*a.first};
  if (std::abs(span - a.count) < 0.3) targets = {*a.first + 0.5, *a.first};
  for (const double candidate : candidates)
    for (const double target : targets)
      if (near(candidate, target, 0.1)) return candidate;
  if (targets.empty()) return std::nullopt;
  // No convention fits: the corners win, freed from the rounding of their six decimals.
  const double half = std::round(targets.front() * 2) / 2;
  return std::abs(half - targets.front()) < 0.02 ? half : targets.front();
}

std::optional<double> first_of(const Reader& a, std::initializer_list<const char*> keywords) {
  for (const char* keyword : keywords)
    if (const auto x = a.maybe(keyword)) return x;
  return std::nullopt;
}

// Whether a printed place is that of a post, give or take conventions and rounding: what is farther off is a mistake of
// which nobody knows whether it is in this number or in the others.
bool agrees(const Axis& axis, double printed, double post) {
  const double tolerance = std::max(2.0, 0.01 * axis.count), d = printed - post;
  return std::abs(axis.period > 0 ? std::remainder(d, axis.period) : d) <= tolerance;
}

// `low` and `high`: keywords that print the first and the last post's place; `sign`: of what grows with the number.
void check_axis(const Reader& label, const Axis& axis, double post, double sign, double centre_deg, double ppd,
                std::initializer_list<const char*> low, std::initializer_list<const char*> high) {
  int agreeing = 0;
  const auto check = [&](const char* keyword, double expected) {
    const auto printed = label.maybe(keyword);
    if (!printed) return;
    if (!agrees(axis, sign * (*printed - centre_deg) * ppd, expected))
      label.fail(std::string(keyword) + " contradicts the rest of the label");
    ++agreeing;
  };
  for (const char* keyword : low) check(keyword, post);
  for (const char* keyword : high) check(keyword, post + axis.count - 1);
  // A zero stands for nothing; and against two pairs of corners an offset is outvoted.
  if (!axis.offset || *axis.offset == 0 || agreeing > 2) return;
  for (const double candidate : {-*axis.offset, *axis.offset})
    if (agrees(axis, candidate, post)) return;
  label.fail("its corners and its projection offset contradict each other");
}

GeographicGrid cylindrical_grid(const Reader& label, const Reader& map, int width, int height) {
  const double ppd = posts_per_degree(map);
  const double centre_lon = map.maybe("CENTER_LONGITUDE").value_or(0);
  if (std::abs(map.maybe("CENTER_LATITUDE").value_or(0)) > 1e-9)
    map.fail("a cylindrical map with a CENTER_LATITUDE other than 0 is not supported");

  Axis rows{height, map.maybe("LINE_PROJECTION_OFFSET"), {}, {}, 0};
  if (const auto north = first_of(label, {"MAXIMUM_LATITUDE", "UPPER_LEFT_LATITUDE"})) rows.first = -*north * ppd;
  if (const auto south = first_of(label, {"MINIMUM_LATITUDE", "LOWER_LEFT_LATITUDE"})) rows.last = -*south * ppd;
  Axis columns{width, map.maybe("SAMPLE_PROJECTION_OFFSET"), {}, {}, 360 * ppd};
  const auto west = first_of(label, {"WESTERNMOST_LONGITUDE", "UPPER_LEFT_LONGITUDE"});
  auto east = first_of(label, {"EASTERNMOST_LONGITUDE", "UPPER_RIGHT_LONGITUDE"});
  if (west && east) {
    if (*east < *west || (*east == *west && width > 1)) *east += 360;  // E359E000
    columns.first = (*west - centre_lon) * ppd;
    columns.last = (*east - centre_lon) * ppd;
  }
  const auto row = first_post(rows);
  const auto column = first_post(columns);
  if (!row) map.fail("its latitudes, LINES, MAP_RESOLUTION and LINE_PROJECTION_OFFSET contradict each other");
  if (!column)
    map.fail("its longitudes, LINE_SAMPLES, MAP_RESOLUTION and SAMPLE_PROJECTION_OFFSET contradict each other");
  check_axis(label, rows, *row, -1, 0, ppd, {"MAXIMUM_LATITUDE", "UPPER_LEFT_LATITUDE", "UPPER_RIGHT_LATITUDE"},
             {"MINIMUM_LATITUDE", "LOWER_LEFT_LATITUDE", "LOWER_RIGHT_LATITUDE"});
  check_axis(label, columns, *column, 1, centre_lon, ppd,
             {"WESTERNMOST_LONGITUDE", "UPPER_LEFT_LONGITUDE", "LOWER_LEFT_LONGITUDE"},
             {"EASTERNMOST_LONGITUDE", "UPPER_RIGHT_LONGITUDE", "LOWER_RIGHT_LONGITUDE"});
  return {-*row / ppd, centre_lon + *column / ppd, ppd, ppd};
}

// Offsets from the pole. LOLA's polar products are symmetric about it, but their labels round half a pixel away in
// different directions: a map that is symmetric to within half a pixel is symmetric.
double polar_offset(const Reader& map, const char* keyword, int count) {
  const double offset = map.number(keyword);
  return std::abs(offset - count / 2.0) < 0.51 ? (count - 1) / 2.0 : offset;
}

// In the plane the metres per pixel are exact and the pixels per degree rounded (LOLA's DSMAP_POLAR.CAT says so).
PolarGrid polar_grid(const Reader& map, int width, int height) {
  PolarGrid g;
  const double pole = map.number("CENTER_LATITUDE");
  if (std::abs(std::abs(pole) - 90) > 1e-9) map.fail("CENTER_LATITUDE of a polar map must be 90 or -90");
  g.north = pole > 0;
  g.central_lon_deg = map.maybe("CENTER_LONGITUDE").value_or(0);
  const auto scale = map_scale_m(map);
  g.spacing_m = scale ? *scale : kMetresPerDegree / posts_per_degree(map);
  if (!(g.spacing_m > 1e-3 && g.spacing_m < 1e6)) map.fail("MAP_SCALE is impossible");
  g.first_x_m = -polar_offset(map, "SAMPLE_PROJECTION_OFFSET", width) * g.spacing_m;
  g.first_y_m = polar_offset(map, "LINE_PROJECTION_OFFSET", height) * g.spacing_m;
  return g;
}

PostGrid find_grid(const Reader& label, const Reader& map, int width, int height) {
  const double radius_km = map.maybe("A_AXIS_RADIUS").value_or(kMoonRadius_m / 1000);
  if (std::abs(radius_km * 1000 - kMoonRadius_m) > 0.5)
    map.fail("its sphere of " + std::to_string(radius_km) + " km is not the Moon's 1737.4 km");
  if (map.maybe("MAP_PROJECTION_ROTATION").value_or(0) != 0) map.fail("rotated maps are not supported");
  if (map.word("POSITIVE_LONGITUDE_DIRECTION") == "WEST") map.fail("west-positive longitudes are not supported");
  std::string type = map.word("MAP_PROJECTION_TYPE");
  std::replace(type.begin(), type.end(), '_', ' ');
  if (type == "POLAR STEREOGRAPHIC") return polar_grid(map, width, height);
  for (const char* name :
       {"SIMPLE CYLINDRICAL", "EQUIRECTANGULAR", "EQUIDISTANT CYLINDRICAL", "EQUIDISTANT", "GEOGRAPHIC"})
    if (type == name) return cylindrical_grid(label, map, width, height);
  map.fail("the map projection '" + type + "' is not supported");
}

std::string format_name(const Reader& label) {
  for (const char* keyword : {"MISSION_NAME", "INSTRUMENT_HOST_NAME", "DATA_SET_ID"}) {
    const std::string word = label.word(keyword);
    if (word.find("SELENE") != std::string::npos || word.starts_with("SLN-")) return "PDS3 Kaguya";
  }
  return label.word("INSTRUMENT_ID") == "LOLA" ? "PDS3 LOLA" : "PDS3";
}

}  // namespace

// ---- public --------------------------------------------------------------------------------------------------------

std::string PdsValue::text() const { return items.empty() ? std::string() : items.front(); }

std::optional<double> PdsValue::number(std::size_t i) const {
  return i < items.size() ? parse_number(items[i]) : std::nullopt;
}

const PdsValue* PdsObject::find(std::string_view keyword) const {
  for (const auto& [key, value] : values)
    if (same_word(key, keyword)) return &value;
  return nullptr;
}

const PdsValue* PdsObject::find_deep(std::string_view keyword) const {
  if (const PdsValue* here = find(keyword)) return here;
  for (const PdsObject& inner : objects)
    if (const PdsValue* there = inner.find_deep(keyword)) return there;
  return nullptr;
}

const PdsObject* PdsObject::find_object(std::string_view object_name) const {
  for (const PdsObject& inner : objects) {
    if (same_word(inner.name, object_name)) return &inner;
    if (const PdsObject* deeper = inner.find_object(object_name)) return deeper;
  }
  return nullptr;
}

PdsObject parse_pds_label(std::string_view text, const std::string& path) { return Parser(text, path).parse(); }

PdsObject read_pds_label(const std::string& path) { return parse_pds_label(read_head(path, kLongestLabel), path); }

bool begins_with_pds_label(const std::string& path) {
  constexpr std::size_t kEnough = 256;
  std::string head;
  try {
    head = read_head(path, kEnough);
  } catch (const DataError&) {
    return false;
  }
  const std::string_view text = trimmed(head);
  // CCSD...: the SFDU line that old archives put before it.
  return text.starts_with("PDS_VERSION_ID") ||
         (text.starts_with("CCSD") && text.find("PDS_VERSION_ID") != std::string_view::npos);
}

bool describes_map(const PdsObject& label) {
  return label.find_object("IMAGE") && label.find_object("IMAGE_MAP_PROJECTION");
}

PdsImage describe_pds_image(const PdsObject& label, const std::string& label_path) {
  const PdsObject* image_object = label.find_object("IMAGE");
  const PdsObject* map_object = label.find_object("IMAGE_MAP_PROJECTION");
  if (!image_object || !map_object)
    throw DataError(label_path, "describes no map (IMAGE or IMAGE_MAP_PROJECTION is missing)");
  const Reader whole(label, label_path), image(*image_object, label_path), map(*map_object, label_path);

  PdsImage out;
  out.format = format_name(whole);
  out.unit_m = unit_in_metres(image);
  out.width = image.count("LINE_SAMPLES");
  out.height = image.count("LINES");
  if (image.maybe("BANDS").value_or(1) != 1) image.no_heights("has several BANDS; a height map has one");
  out.sample = sample_type(image);
  out.scale = image.maybe("SCALING_FACTOR").value_or(1);
  out.offset = image.maybe("OFFSET").value_or(0);
  if (out.scale == 0) image.fail("SCALING_FACTOR is zero");
  out.voids = void_values(image, out.sample);

  const double prefix = image.maybe("LINE_PREFIX_BYTES").value_or(0);
  const double suffix = image.maybe("LINE_SUFFIX_BYTES").value_or(0);
  if (prefix < 0 || suffix < 0 || prefix + suffix > 1e6)
    image.fail("LINE_PREFIX_BYTES or LINE_SUFFIX_BYTES is impossible");
  out.row_bytes = static_cast<std::uint64_t>(out.width) * static_cast<std::uint64_t>(out.sample.bytes) +
                  static_cast<std::uint64_t>(prefix + suffix);
  find_pixels(whole, label_path, out);
  out.first_byte += static_cast<std::uint64_t>(prefix);
  out.grid = find_grid(whole, map, out.width, out.height);
  check_data_size(label_path, out);
  return out;
}

}  // namespace selenograph::dem
