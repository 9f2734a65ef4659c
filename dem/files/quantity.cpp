#include "dem/files/quantity.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "dem/base/names.h"

namespace selenograph::dem {
namespace {

enum class Match { exact, prefix };

struct QuantityWord {
  std::string_view word;
  std::string_view quantity;
  Match match = Match::exact;
};

// Words in lower case, without digits at their end. They include names of products:
//   LOLA: gridded data (LDEM, LDSM, LDRM, LDEC, LDAM, LPSR, AVGVISIB), 5 m sites (_surf, _slp, _toterr, _slperr, _ldec,
//         _effres, _err)
//   Kaguya: DTM_MAP, TCO_MAP    LROC: NAC_DTM (_SHADE, _CONF, _SLOPE), GLD, WAC_EMP    Diviner: DGDR
constexpr QuantityWord kWords[] = {
    {"dem", kHeights},
    {"ldem", kHeights},
    {"sldem", kHeights},
    {"dtm", kHeights},
    {"gld", kHeights},
    {"surf", kHeights},
    {"height", kHeights, Match::prefix},
    {"elevation", kHeights, Match::prefix},
    {"altitude", kHeights, Match::prefix},
    {"topograph", kHeights, Match::prefix},
    {"radius", kHeights},
    {"ldsm", "slopes"},
    {"slp", "slopes"},
    {"slope", "slopes", Match::prefix},
    {"clrslope", "slopes"},
    {"gradient", "slopes", Match::prefix},
    {"aspect", "aspects", Match::prefix},
    {"effres", "effective resolution"},
    {"err", "error of heights"},
    {"toterr", "error of heights"},
    {"error", "error of heights", Match::prefix},
    {"uncertaint", "error of heights", Match::prefix},
    {"sigma", "error of heights"},
    {"stdev", "error of heights"},
    {"stddev", "error of heights"},
    {"slperr", "error of slopes"},
    {"ldec", "counts"},
    {"count", "counts"},
    {"counts", "counts"},
    {"ldrm", "roughness"},
    {"roughness", "roughness"},
    {"ldam", "albedo"},
    {"albedo", "albedo", Match::prefix},
    {"emp", "albedo"},
    {"reflect", "albedo", Match::prefix},
    {"radiance", "images"},
    {"avgvisib", "illumination"},
    {"illum", "illumination", Match::prefix},
    {"visibility", "illumination"},
    {"lpsr", "permanent shadow"},
    {"shade", "shaded relief", Match::prefix},
    {"clrshade", "shaded relief"},
    {"hillshade", "shaded relief", Match::prefix},
    {"shadow", "shadows", Match::prefix},
    {"conf", "confidence"},
    {"clrconf", "confidence"},
    {"confidence", "confidence"},
    {"tco", "images"},
    {"orthoimage", "images", Match::prefix},
    {"orthophoto", "images", Match::prefix},
    {"temperature", "temperatures", Match::prefix},
    {"dgdr", "temperatures"},
    {"mask", "a mask"},
    {"curvature", "curvature"},
    {"hazard", "hazards", Match::prefix},
};

// Returns the quantity that a word names; empty if it names none.
std::string_view quantity_of_word(std::string_view word) {
  while (!word.empty() && std::isdigit(static_cast<unsigned char>(word.back()))) word.remove_suffix(1);
  for (const QuantityWord& entry : kWords)
    if (entry.match == Match::exact ? word == entry.word : word.starts_with(entry.word)) return entry.quantity;
  return {};
}

// Calls visit(word) with each run of letters and digits.
template <typename Visit>
void for_each_word(std::string_view text, const Visit& visit) {
  const auto in_word = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0; };
  for (auto word = text.begin(); word != text.end();) {
    word = std::find_if(word, text.end(), in_word);
    const auto past = std::find_if_not(word, text.end(), in_word);
    if (word != past) visit(std::string_view(&*word, static_cast<std::size_t>(past - word)));
    word = past;
  }
}

// Returns true for a number of an image of LROC's narrow-angle camera, "M1234567890LE": an orthoimage has such a number
// in its name.
bool is_nac_image(std::string_view word) {
  const std::string_view number = word.substr(0, word.find_first_not_of("0123456789", 1)).substr(1);
  return word.front() == 'm' && (number.size() == 9 || number.size() == 10);
}

}  // namespace

std::string_view quantity_in_words(std::string_view text) {
  std::string_view found;
  const std::string words = lower(text);
  for_each_word(words, [&](std::string_view word) {
    const std::string_view quantity = quantity_of_word(word);
    if (!quantity.empty() && (found.empty() || found == kHeights)) found = quantity;
  });
  return found;
}

std::string_view quantity_in_name(std::string_view path) {
  std::string_view found;
  const std::string name = lower(stem_of(name_of(path)));
  const bool is_nac_product = name.starts_with("nac_dtm_");
  for_each_word(name, [&](std::string_view word) {
    const std::string_view quantity = is_nac_product && is_nac_image(word) ? "images" : quantity_of_word(word);
    if (!quantity.empty()) found = quantity;
  });
  return found;
}

SideRaster::SideRaster(const std::string& path, std::string_view quantity, std::string_view origin)
    : NotHeights(path, fmt::format("is a side layer, not heights: by {} it holds {}. {}", origin, quantity,
                                   kHowToDeclareHeights)),
      quantity_(quantity) {}

}  // namespace selenograph::dem
