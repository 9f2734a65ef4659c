// Refuses cameras and instruments inside a closed object or a rock.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/camera/row_views.h"
#include "engine/frame/objects.h"
#include "engine/scene/object_shape.h"

namespace selenograph::engine {

// Returns the winding number of a mesh around a point in its coordinates: 0 outside a closed mesh, 1 or -1 inside, and
// in between for an open mesh (sum of solid angles: Van Oosterom & Strackee, IEEE Trans. Biomed. Eng. 30, 125, 1983).
double winding_number(const ObjectShape& shape, const Vec3& point);

// Throws ImpossibleRequest (member "") if a position (MOON_ME, m) is inside a closed object or, with `terrain`, inside
// a rock of its detail. A mesh that is open, or whose triangles do not all wind the same way, has no inside. `subject`
// names the camera or instrument in the message: "the camera". `terrain` may be null.
void refuse_enclosed(const dem::Terrain* terrain, const std::vector<SceneObject>& objects, const Vec3& position_m,
                     const std::string& subject, const StopToken& stop);
// Checks a camera: the positions of up to kMaxCameraPlaces of its rows, if it moves.
inline constexpr std::size_t kMaxCameraPlaces = 16;
void refuse_enclosed(const dem::Terrain* terrain, const std::vector<SceneObject>& objects, const RowViews& views,
                     const StopToken& stop);

}  // namespace selenograph::engine
