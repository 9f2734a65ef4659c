// Draws the discs of the Sun and the Earth into a frame.
#pragma once

#include <span>
#include <vector>

#include "engine/sky/sky_in_view.h"

namespace selenograph::engine {

// Adds the requested discs to a frame's radiance, W m-2 sr-1, each pixel as the mean over its area. A disc's total
// irradiance is right to 0.2 %, also that of a crescent a twentieth of a pixel thin, and to 0.5 % for a disc within a
// pixel.
//
// Visibility: `range_m` is the range of every pixel, NaN for the sky. At a border, where a pixel or its neighbour shows
// the Moon or an object and another shows the sky, rays in double against the finest terrain decide, 64 per pixel or
// more. Elsewhere the pixels decide, and on ground with detail they decide everywhere (hides_by_pixels).
//
// Sun: its irradiance over its disc, with limb darkening 1 - u (1 - mu), where u is the request's or 0.6. The Earth
// occludes it, requested or not. Earth: an ellipsoid (WGS 84), rotated by SkyObserver::earth_from_icrf, lit by
// Lambert's law and scaled to the irradiance of the whole disc (earth_over_sun). The request's map modulates the
// brightness relative to its mean over the visible lit surface, weighted by light: the disc keeps the published
// magnitude at its phase.
//
// Throws as find_hidden does, and ImpossibleRequest for a map that is 0 on the whole visible lit surface.
void add_discs(const FrameRequest& request, std::span<const double> range_m, const RenderContext& context,
               std::vector<float>& radiance);

}  // namespace selenograph::engine
