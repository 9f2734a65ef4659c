// The discs of the Sun and the Earth in a frame.
#pragma once

#include <span>
#include <vector>

#include "engine/sky/sky_in_view.h"

namespace selenograph::engine {

// Adds the discs that the request asks for to a frame's radiance, W m-2 sr-1, each pixel as the mean over its area: all
// of a disc has its irradiance to 0.2 %, a crescent of a twentieth of a pixel, too, and one within a pixel to 0.5 %.
// `range_m`: of every pixel, NaN for the sky. Where a pixel or one beside it sees the Moon or an object and another one
// the sky, rays in double against the finest terrain decide, 64 a pixel and more; elsewhere the pixels themselves, and
// on ground with detail everywhere (hides_by_pixels).
//
// Sun: its irradiance over its disc, with limb darkening 1 - u (1 - mu): the request's u, or 0.6. The part covered by
// the Earth is left out, whether the Earth is requested or not. Earth: an ellipsoid (WGS 84), turned as
// SkyObserver::earth_from_icrf says, lit by Lambert's law and scaled to the irradiance of the whole (earth_over_sun).
// The request's map makes places brighter or darker than their mean, which is taken over all that is lit and seen, by
// its light: the whole keeps the published magnitude at its phase.
//
// Throws as find_hidden does, and ImpossibleRequest for a map that is 0 in all that is lit and seen.
void add_discs(const FrameRequest& request, std::span<const double> range_m, const dem::Terrain& terrain,
               RenderCache& kept, const StopToken& stop, std::vector<float>& radiance);

}  // namespace selenograph::engine
