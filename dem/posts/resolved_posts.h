// Resolution of DEM files: the posts of a file may be denser than the heights from which it was made.
#pragma once

#include <string>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/posts/layer_joins.h"

namespace selenograph::dem {

// "PATTERN=POSTS" (the spacing of independent heights, in posts) or "PATTERN=fit". Throws std::invalid_argument.
NamedNumber parse_resolved_posts(const std::string& text);

// Of files of one layer, from heights of some places along meridians. Second differences of resolved ground grow with
// the distance as its Hurst exponent says, by less than the power 1.45; between posts that were interpolated by
// bicubics they grow with its square, and in linear interpolation they are at every n-th post alone. Steps of whole
// metres are taken out. 1 to 32; 0 where it can't be measured: steps hide too much, or too little is valid. Throws
// DataError, SystemFault.
int measured_resolved_posts(const Catalogue& catalogue, const std::vector<int>& files);

struct ResolvedLayer {
  int source;  // its first file
  int posts;   // 0: can't be measured, and 1 is taken
};
// Tells the catalogue what its files resolve, before any detail is made. If several patterns match a file the last one
// applies. Returns what was measured. Throws DataError naming a pattern that matches no file, and as above.
std::vector<ResolvedLayer> resolve_posts(Catalogue& catalogue, const std::vector<NamedNumber>& settings);

}  // namespace selenograph::dem
