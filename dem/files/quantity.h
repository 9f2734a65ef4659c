// Quantity of a raster's samples, by words in a label, a band's description or a file's name.
#pragma once

#include <string>
#include <string_view>

#include "dem/base/error.h"

namespace selenograph::dem {

inline constexpr std::string_view kHeights = "heights";

// Returns the quantity that a short text such as "HEIGHT" or "Slope (degrees)" names: kHeights, another one such as
// "slopes", or empty. Another quantity takes precedence over heights: "height error".
std::string_view quantity_in_words(std::string_view text);
// Returns the same for a file's name, in which the last word that names a quantity decides: "LDEM_4",
// "Site01_surf_slp.tif".
std::string_view quantity_in_name(std::string_view path);

// Advice in errors about rasters that do not look like heights.
inline constexpr std::string_view kHowToDeclareHeights =
    "If it does hold heights in metres, describe its band as \"height\": see dem/files/products.md";

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
