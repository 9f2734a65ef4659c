// Quantity of a raster's samples, by words in a label, a band's description or a file's name.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "dem/base/error.h"

namespace selenograph::dem {

inline constexpr std::string_view kHeights = "heights";

// Returns the quantity that a short text such as "HEIGHT" or "Slope (degrees)" names: kHeights, another one such as
// "slopes", or empty. Another quantity takes precedence over heights: "height error".
std::string_view quantity_in_words(std::string_view text);
// Returns the same for a file's name, in which the last word that names a quantity decides: "LDEM_4",
// "Site01_surf_slp.tif".
std::string_view quantity_in_name(std::string_view path);

// Sets the patterns of names of files (as in a shell, with or without extension) that hold heights regardless of their
// words and values. Process-wide: call it before files are opened.
void take_as_heights(std::vector<std::string> patterns);
const std::vector<std::string>& patterns_taken_as_heights();
bool is_taken_as_heights(const std::string& path);

// Returns the advice in errors about rasters that do not look like heights.
std::string how_to_override(std::string_view path);

// Thrown for a raster whose words say that it holds another quantity next to the heights of a product, e.g. their
// errors.
class SideRaster : public NotHeights {
 public:
  // `origin` describes the source of the words, e.g. "its name".
  SideRaster(const std::string& path, std::string_view quantity, std::string_view origin);
  const std::string& quantity() const { return quantity_; }

 private:
  std::string quantity_;
};

}  // namespace selenograph::dem
