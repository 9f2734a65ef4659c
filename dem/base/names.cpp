#include "dem/base/names.h"

#include <fnmatch.h>

#include <algorithm>
#include <cctype>
#include <iterator>

namespace selenograph::dem {
namespace {

char lower_of(char c) { return static_cast<char>(std::tolower(static_cast<unsigned char>(c))); }

struct LengthUnit {
  std::string_view name;
  double metres;
};

constexpr double kFoot_m = 0.3048, kUsSurveyFoot_m = 1200.0 / 3937;
// Names of units in files by GDAL, PROJ and PDS.
constexpr LengthUnit kUnits[] = {{"m", 1},
                                 {"metre", 1},
                                 {"metres", 1},
                                 {"meter", 1},
                                 {"meters", 1},
                                 {"km", 1000},
                                 {"kilometre", 1000},
                                 {"kilometres", 1000},
                                 {"kilometer", 1000},
                                 {"kilometers", 1000},
                                 {"cm", 0.01},
                                 {"centimetre", 0.01},
                                 {"centimeter", 0.01},
                                 {"mm", 0.001},
                                 {"millimetre", 0.001},
                                 {"millimeter", 0.001},
                                 {"ft", kFoot_m},
                                 {"foot", kFoot_m},
                                 {"feet", kFoot_m},
                                 {"international foot", kFoot_m},
                                 {"us-ft", kUsSurveyFoot_m},
                                 {"ftus", kUsSurveyFoot_m},
                                 {"foot_us", kUsSurveyFoot_m},
                                 {"us survey foot", kUsSurveyFoot_m}};

}  // namespace

std::string lower(std::string_view text) {
  std::string out(text);
  std::transform(out.begin(), out.end(), out.begin(), lower_of);
  return out;
}

bool same_text(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](char x, char y) { return lower_of(x) == lower_of(y); });
}

bool consists_of(std::string_view text, std::string_view punctuation) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [&](unsigned char c) {
    return (c < 128 && std::isalnum(c)) || punctuation.find(static_cast<char>(c)) != std::string_view::npos;
  });
}

std::string_view name_of(std::string_view path) { return path.substr(path.rfind('/') + 1); }

std::string_view stem_of(std::string_view name) {
  const std::size_t dot = name.rfind('.');
  return dot == std::string_view::npos || dot == 0 ? name : name.substr(0, dot);
}

bool name_matches(const std::string& path, const std::string& pattern) {
  const std::string name(name_of(path));
  const std::string stem(stem_of(name));
  return ::fnmatch(pattern.c_str(), stem.c_str(), 0) == 0 || ::fnmatch(pattern.c_str(), name.c_str(), 0) == 0;
}

std::optional<double> metres_in(std::string_view unit) {
  const auto found =
      std::find_if(std::begin(kUnits), std::end(kUnits), [&](const LengthUnit& u) { return same_text(u.name, unit); });
  return found == std::end(kUnits) ? std::nullopt : std::optional(found->metres);
}

}  // namespace selenograph::dem
