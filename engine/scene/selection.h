// Selects the blocks of a frame and their levels of detail, including shadow casters outside the view.
//
// The selection depends on the request and the terrain only, never on what is loaded. A block in view is refined until
// its posts are at most 2 max_error_px pixels apart and its vertical error (to the finest surface, plus the sag of
// chords) projects to at most max_error_px; for terrain with detail, to at most max_detail_error_px. Terrain out of
// view is kept where its shadow can reach the view. All terrain that can cast a shadow into view is refined until its
// vertical error displaces a shadow edge on level ground by at most max_shadow_error_px: the error over the tangent of
// the Sun's elevation where the shadow falls.
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
#include "engine/frame/queries.h"
#include "engine/frame/request.h"
#include "engine/frame/sun.h"
#include "engine/scene/selected_blocks.h"

namespace selenograph::engine {

// `sun`: null if shadows are not needed. Throws TooMuchTerrain when the scene does not fit even without the shadow
// target, which is relaxed by factors of two until it fits.
Selection select_for_view(const dem::Terrain& terrain, const View& view, const Sun* sun, const Accuracy& accuracy,
                          const StopToken& stop, const SceneRoom& room = {});
// The same for several views: the union of what they see, each block as fine as the most demanding view needs it.
// `receivers`: bounding spheres of objects in view that receive shadows.
Selection select_for_views(const dem::Terrain& terrain, std::span<const ViewBundle> views, const Sun* sun,
                           const Accuracy& accuracy, const StopToken& stop, const SceneRoom& room = {},
                           const std::vector<Ball>& receivers = {});

double triangles_of(const Selection& selection);

// Chosen visibility algorithm: as requested or, by default, the z-buffer, whose time grows with the triangles, except
// for tiny images of much terrain, which are ray traced, because that time grows with the pixels. It depends on the
// request and the terrain only, so that the same request gives the same bytes.
Visibility visibility_for(const FrameRequest& request, const RowViews& views, const Selection& selection);

// Throws ImpossibleRequest when a place (MOON_ME, m) is at the terrain or below it. `subject` says what is there, as in
// "the camera"; `member`: that of the error.
void refuse_buried(const dem::Terrain& terrain, const Vec3& position_m, const std::string& subject,
                   const std::string& member, const StopToken& stop = {});
// The same for a camera in any row of the frame.
void refuse_underground(const dem::Terrain& terrain, const RowViews& views, const StopToken& stop = {});

}  // namespace selenograph::engine
