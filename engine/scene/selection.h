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

namespace selenograph::engine {

struct Selection {
  std::vector<dem::BlockId> blocks;  // sorted; neighbouring levels differ by at most one
  double error_px = 0, error_m = 0;  // bounds over the blocks in view
  double detail_error_px = 0;        // of that, what the terrain's detail adds
  double detail_limit_px = 0;        // Accuracy::max_detail_error_px, or what it gave way to; 0: there is no detail
  double shadow_error_px = 0;        // bound on the displacement of shadow edges on level ground
  double shadow_limit_px = 0;        // Accuracy::max_shadow_error_px, or what it gave way to
  double min_spacing_m = 0, max_spacing_m = 0;
  double highest_m = 0;                      // no block reaches higher
  std::vector<dem::SourceIndex> replaced{};  // unusable files that something in it or in view lacks; ascending
};

// What a scene holds of a block, about: its vertices as float for the z-buffer, with those of the mesh where its border
// is another than the posts', or Embree's 15 bytes a triangle; the posts are the terrain cache's. (Automatic visibility
// takes rays for small frames alone.) Coarse levels have fewer quads: the whole Moon from afar is thousands of small
// blocks.
inline std::size_t scene_bytes_of(const dem::BlockId& id, Visibility visibility) {
  const auto quads = static_cast<std::size_t>(dem::quads_per_side(id.level));
  const std::size_t vertices = (quads + 1) * (quads + 1);
  return 2 * vertices + (visibility == Visibility::raytrace ? 2 * quads * quads * 15 : 22 * vertices);
}

struct SceneRoom {
  std::size_t bytes = std::numeric_limits<std::size_t>::max();
  Visibility visibility = Visibility::automatic;  // of the scene that it is for
};

// Past this many blocks (a million quads per 256) a request is refused: TooMuchTerrain.
inline constexpr std::size_t kMaxBlocks = 6000;

// What isn't terrain but receives its shadows.
struct Ball {
  Vec3 centre_m;
  double radius_m;
};

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
