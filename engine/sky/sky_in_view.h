// Stars, the Sun, the Earth and planets in a camera's image, for POST /v1/sky and for frames.
#pragma once

#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/camera/row_views.h"
#include "engine/frame/request.h"
#include "engine/sky/earth_figure.h"

namespace selenograph::engine {

struct RenderContext;

// Limit on stars of one image.
inline constexpr std::size_t kMostStars = 100000;
// Distance at which stars are projected: far enough to have no parallax between the rows of a moving camera, and near
// enough for a double to hold the direction.
inline constexpr double kStarDistance_m = 1e15;

// Returns the requested stars within `margin_px` of the image, brightest first, and then the Sun, the Earth and the
// planets wherever they are. `hidden_by` and `electrons` are not set. `views`: those of the request's camera. Throws
// ImpossibleRequest for too many stars.
std::vector<SkyObject> sky_around(const FrameRequest& request, const RowViews& views, double margin_px,
                                  const StopToken& stop);

// Returns the same for rows with views of their own: all objects that may be within `margin_px` of any row, without
// positions in the image.
std::vector<SkyObject> sky_around_rows(const FrameRequest& request, const RowViews& views, double margin_px,
                                       const StopToken& stop);

// Returns the Earth as the camera sees it at the epoch of the request's sky, which the request must have.
EarthFigure earth_of(const FrameRequest& request, const RowViews& views);

// Sets `hidden_by` of the imaged objects, by one ray each against the finest terrain, rocks, objects and the Earth.
// `range_m`: if not empty, the range of every pixel, NaN for the sky; then the pixel nearest to an object decides
// instead of terrain and rocks (hides_by_pixels). Throws as cast_rays does.
void find_hidden(const FrameRequest& request, const RowViews& views, std::span<const double> range_m,
                 const RenderContext& context, std::vector<SkyObject>& sky);

// Returns the solid angle of a pixel-sized square around an image point, sr; empty where the lens images nothing.
std::optional<double> pixel_sr(const RowViews& views, double x_px, double y_px);

// Returns stars, the Sun, the Earth and planets of request.sky in the image of its camera, with their occluders. Reads
// the request's camera, pose, shutter, band, objects, detail, terrain, sensor and sky. Throws ImpossibleRequest for too
// many stars, and as Renderer::render does.
std::vector<SkyObject> query_sky(const FrameRequest& request, const RenderContext& context);

}  // namespace selenograph::engine
