// The detail that a lander's map shows.
#pragma once

#include <memory>

#include "dem/detail/detail.h"
#include "dem/map_error/map_error.h"

namespace selenograph::dem {

// Returns the detail without what the map lacks: craters below MapError::missing_craters_below_m, and with them all
// rocks, fragments and clods. The diameter is rounded up to a power of two, where octaves begin: each octave is drawn
// by itself, so that all others stay as they are. Returns the same object if nothing is missing, and null for null.
std::shared_ptr<const Detail> detail_of_map(const std::shared_ptr<const Detail>& detail, const MapError& error);

}  // namespace selenograph::dem
