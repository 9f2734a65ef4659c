// Stars, the Sun, the Earth and planets in a camera's image: POST /v1/sky, and what a frame shows of them.
#pragma once

#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/cache/render_cache.h"
#include "engine/camera/row_views.h"
#include "engine/frame/request.h"
#include "engine/sky/earth_figure.h"

namespace selenograph::engine {

// Limit on stars of one image.
inline constexpr std::size_t kMostStars = 100000;
// Far enough for each row of a moving camera to see it in the same direction; a double holds its direction.
inline constexpr double kStarDistance_m = 1e15;

// Of the request's sky, stars within `margin_px` of the image, brightest first, and then the Sun, the Earth and the
// planets wherever they are. Without `hidden_by` and `electrons`. `views`: of the request's camera. Throws
// ImpossibleRequest for too many stars.
std::vector<SkyObject> sky_around(const FrameRequest& request, const RowViews& views, double margin_px,
                                  const StopToken& stop);

// The same where rows have views of their own: all that may be within `margin_px` of any of them, without places.
std::vector<SkyObject> sky_around_rows(const FrameRequest& request, const RowViews& views, double margin_px,
                                       const StopToken& stop);

// The Earth where the request's sky, which it must have, puts it for the camera.
EarthFigure earth_of(const FrameRequest& request, const RowViews& views);

// Sets `hidden_by`, by one ray each against the finest terrain, rocks, objects and the Earth, of those that are imaged.
// `range_m`: of every pixel, NaN for the sky, where the pixel that a place is in decides instead of terrain and rocks
// (hides_by_pixels), the nearest one for a place beside the image; else empty. Runs in the caller's task arena. Throws
// as cast_rays does.
void find_hidden(const FrameRequest& request, const RowViews& views, std::span<const double> range_m,
                 const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop, std::vector<SkyObject>& sky);

// Solid angle of a pixel's width and height around an image place, sr; empty where the lens images nothing.
std::optional<double> pixel_sr(const RowViews& views, double x_px, double y_px);

// Results and exceptions are those of Renderer::sky.
std::vector<SkyObject> query_sky(const FrameRequest& request, const dem::Terrain& terrain, RenderCache& kept,
                                 const StopToken& stop);

}  // namespace selenograph::engine
