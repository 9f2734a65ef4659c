// Resolution of DEM files: the posts of a file may be denser than the heights from which it was made.
#pragma once

#include <string>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/posts/layer_joins.h"

namespace selenograph::dem {

// Parses "PATTERN=POSTS" (the spacing of independent heights, in posts) or "PATTERN=fit". Throws std::invalid_argument.
NamedNumber parse_resolved_posts(const std::string& text);

// Returns the spacing of independent heights in files of one layer, in posts, 1 to 32, measured on sample squares.
// Returns 0 if it cannot be measured: steps of whole metres hide too much, or too few posts are valid. Throws
// DataError, SystemFault.
//
// Second differences along meridians of resolved ground grow with the distance by its Hurst exponent, a power below
// 1.45. Between posts interpolated by bicubics they grow by nearly the square. In linear interpolation only every n-th
// post has a second difference. The contribution of steps of whole metres is subtracted.
int measure_resolved_posts(const Catalogue& catalogue, const std::vector<int>& files);

struct ResolvedLayer {
  int source;  // first file of the layer
  int posts;   // spacing of independent heights; 0: not measurable, the catalogue then uses 1
};
// Sets the resolved posts of the catalogue's files. Call it before any detail is made. If several patterns match a file
// the last one applies. Returns the measured layers. Throws DataError naming a pattern that matches no file, and as
// measure_resolved_posts() does.
std::vector<ResolvedLayer> resolve_posts(Catalogue& catalogue, const std::vector<NamedNumber>& settings);

}  // namespace selenograph::dem
