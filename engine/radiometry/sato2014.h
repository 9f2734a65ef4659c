// Hapke parameters of the Moon: Sato et al. (JGR Planets 119, 1775, 2014), from images of the LROC WAC in seven bands
// from 0.321 to 0.689 um; fitted for incidence below 75, emission below 30 and phase below 97 degrees. Two lobes of
// phase function (double Henyey-Greenstein), shadow hiding alone, mean slope 23.657 degrees.
//
// sato2014.csv holds four regions, made from the published maps reduced to cells of 32 x 32 degrees (lrowacphomap, USGS
// ISIS test data, CC0): 0, medians over the cells from 30 S to 30 N; 1, means over those of the near side, weighted as
// the Earth sees them; 2, the cell at 22 N, 56 W (Oceanus Procellarum); 3, medians over those of the cells of 0 that
// lie beyond 112 degrees of longitude.
#pragma once

#include <string_view>

#include "engine/frame/surface.h"

namespace selenograph::engine {

enum class SatoRegion { global, near_side, mare, highlands };

inline constexpr double kSatoFirst_um = 0.321, kSatoLast_um = 0.689;

// Returns a region's parameters, linear between bands and constant beyond the first and last.
HapkeParameters sato2014(SatoRegion region, double wavelength_um);

std::string_view sato2014_csv();  // made by deploy/support/embed.cmake

}  // namespace selenograph::engine
