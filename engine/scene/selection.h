// Which blocks a frame needs, and how fine: level of detail by error, casters outside the view.
//
// A function of the request and the terrain only, never of what happens to be loaded: the same request selects the same
// blocks. A block in view is refined until its posts are at most 2 max_error_px pixels apart and its vertical error (to
// the finest surface, plus the chord's sag) projects to at most max_error_px, of terrain with detail to at most
// max_detail_error_px. Terrain that is not in view is kept where
// its shadow can reach what is. All terrain that can cast a shadow into view is refined until its vertical error moves
// a shadow's edge on level ground by at most max_shadow_error_px: that is the error over the tangent of the Sun's
// elevation where the shadow falls.
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/camera/row_views.h"
#include "engine/camera/view.h"
#include "engine/frame/accuracy.h"
#include "engine/frame/queries.h"
#include "engine/frame/request.h"
#include "engine/frame/sun.h"
#include "engine/scene/selected_blocks.h"

namespace selenograph::engine {

// `sun` null: shadows don't matter. `receivers`: besides the terrain; what of them is in view. Throws TooMuchTerrain
// when the scene has no room even without the aim for shadows, which gives way by factors of two until it fits.
Selection select_for_view(const dem::Terrain& terrain, const View& view, const Sun* sun, const Accuracy& accuracy,
                          const StopToken& stop, const SceneRoom& room = {}, const std::vector<Ball>& receivers = {});
// The same of several views: what any of them sees, as fine as the one needs that needs the finest.
Selection select_for_views(const dem::Terrain& terrain, std::span<const ViewBundle> views, const Sun* sun,
                           const Accuracy& accuracy, const StopToken& stop, const SceneRoom& room = {},
                           const std::vector<Ball>& receivers = {});

double triangles_of(const Selection& selection);

// Which way the frame is seen, where the request leaves it open: by z-buffer, whose time grows with the triangles, but
// tiny images of much terrain by rays, whose time grows with the pixels. From the request and the terrain alone, so
// that the same request gives the same bytes.
Visibility visibility_for(const FrameRequest& request, const RowViews& views, const Selection& selection);

// Throws ImpossibleRequest for a camera that is below the terrain, be it in one row of the frame.
void refuse_underground(const dem::Terrain& terrain, const RowViews& views, const StopToken& stop = {});

}  // namespace selenograph::engine
