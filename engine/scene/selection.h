// Selects the blocks of a frame and their levels of detail, with occluders out of view.
//
// The selection depends on the request and the terrain only, never on what is loaded. A block in view is refined until
// its posts are at most 2 max_error_px pixels apart and its vertical error (to the finest surface, plus the sag of
// chords) projects to at most max_error_px; for terrain with detail, to at most max_detail_error_px. Terrain out of
// view is selected if its shadow can reach the view. All terrain that can cast a shadow into view is refined until its
// vertical error shifts a shadow edge on level ground by at most max_shadow_error_px: the error over the tangent of the
// Sun's elevation at the receiver.
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/camera/row_views.h"
#include "engine/camera/view.h"
#include "engine/frame/accuracy.h"
#include "engine/frame/request.h"
#include "engine/frame/sun.h"
#include "engine/scene/selected_blocks.h"

namespace selenograph::engine {

// Selects the blocks of one view. `sun`: null if shadows are not needed. Throws TooMuchTerrain if the scene does not
// fit even without the shadow target, which is relaxed by factors of two until it fits.
Selection select_for_view(const dem::Terrain& terrain, const View& view, const Sun* sun, const Accuracy& accuracy,
                          const StopToken& stop, const SceneBudget& budget = {});
// Selects the blocks of several views: their union, each block as fine as the most demanding view needs it.
// `receivers`: bounding spheres of objects in view that receive shadows.
Selection select_for_views(const dem::Terrain& terrain, std::span<const ViewBundle> views, const Sun* sun,
                           const Accuracy& accuracy, const StopToken& stop, const SceneBudget& budget = {},
                           const std::vector<Ball>& receivers = {});

double triangles_of(const Selection& selection);

// Returns the visibility algorithm: as requested or, by default, the z-buffer, whose time grows with the triangles.
// Tiny images of much terrain are ray traced, because that time grows with the pixels. The choice depends on the
// request and the terrain only, so that the same request gives the same bytes.
Visibility visibility_for(const FrameRequest& request, const RowViews& views, const Selection& selection);

// Throws ImpossibleRequest if a position (MOON_ME, m) is at the terrain or below it. `subject`: the object at the
// position, as in "the camera"; `member`: the request's member for the error.
void refuse_buried(const dem::Terrain& terrain, const Vec3& position_m, const std::string& subject,
                   const std::string& member, const StopToken& stop = {});
// Throws ImpossibleRequest if the camera of any row is at the terrain or below it.
void refuse_underground(const dem::Terrain& terrain, const RowViews& views, const StopToken& stop = {});

}  // namespace selenograph::engine
