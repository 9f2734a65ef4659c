// What DEM files resolve: the posts of a file may be closer to each other than what it was made from.
#pragma once

#include <string>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/posts/layer_joins.h"

namespace selenograph::dem {

// "PATTERN=POSTS" (the spacing of independent heights, in posts) or "PATTERN=fit". Throws std::invalid_argument.
NamedNumber parse_resolved_posts(const std::string& text);

// Of files of one layer, from heights of some places along meridians. Second differences of resolved ground grow with
// the distance as its Hurst exponent says, by less than the power 1.5; between posts that were interpolated they grow
// with its square. Steps of whole metres are taken out. 1, 2, 4 .. 32; 1 where too little is valid. Throws DataError,
// SystemFault.
int measured_resolved_posts(const Catalogue& catalogue, const std::vector<int>& files);

struct ResolvedLayer {
  int source;  // its first file
  int posts;
};
// Tells the catalogue what its files resolve, before any detail is made. If several patterns match a file the last one
// applies. Returns what was measured. Throws DataError naming a pattern that matches no file, and as above.
std::vector<ResolvedLayer> resolve_posts(Catalogue& catalogue, const std::vector<NamedNumber>& settings);

}  // namespace selenograph::dem
