// A round trip as a picture: the map of differences with its colour bar, their histogram, and what they amount to.
#pragma once

#include <string>

#include "api/canvas.h"
#include "engine/verify/difference_statistics.h"

namespace selenograph::api {

// A length with three digits in the unit that suits it: "0.0831 nm", "−1.27 mm", "8.16 m"; "none" for NaN.
std::string length_text(double length_m);

// `title` stands above, e.g. tile and mode. The colours reach to the 99.5th percentile on both sides of zero, rounded
// up; posts that were not compared are grey. A pixel of the map is one post, or the mean over a square of posts where
// there are more than 1000 along a side.
Canvas difference_picture(const engine::RoundTrip& trip, const engine::DifferenceStatistics& statistics,
                          const std::string& title);

}  // namespace selenograph::api
