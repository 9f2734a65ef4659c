// Finds gaps in a catalogue's coverage, for `info`.
#pragma once

#include <vector>

#include "dem/catalogue/catalogue.h"

namespace selenograph::server {

// Returns the boxes of whole degrees within the catalogue's bounding box that no file touches, from south to north.
// Holes smaller than a degree, and voids inside a file, are not detected. West is in [-180, 180), east greater than
// west.
std::vector<dem::Footprint> uncovered(const dem::Catalogue& catalogue);

}  // namespace selenograph::server
