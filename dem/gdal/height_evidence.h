// Decides if a raster holds heights, by the words about it, else by its values.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "dem/files/quantity.h"
#include "dem/files/raster_info.h"

namespace selenograph::dem {

// Short text about the samples, and its origin, e.g. "its label".
struct SampleWords {
  std::string_view text;
  std::string_view origin;
};

// Returns the quantity that the words name: kHeights or empty. Throws SideRaster if the words, or if they name none the
// names of file or product, say that the raster holds another quantity.
std::string_view check_words(const std::string& path, std::initializer_list<SampleWords> words,
                             std::initializer_list<std::string_view> names);

// Heights of a few evenly spread posts, without voids, and their steps to the next row.
struct SparseHeights {
  std::vector<double> heights_m;
  std::vector<double> steps_m;
};

// Throws NotHeights if samples without a declared unit cannot be the Moon's heights in metres.
void check_values(const RasterInfo& info, SparseHeights sparse);

}  // namespace selenograph::dem
