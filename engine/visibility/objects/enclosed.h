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

// Winding number of a mesh around a place in its coordinates: 0 outside a closed mesh and 1 or -1 inside; between them
// for an open mesh (sum of solid angles: Van Oosterom & Strackee, IEEE Trans. Biomed. Eng. 30, 125, 1983).
double winding_number(const ObjectShape& shape, const Vec3& point);

// Throws ImpossibleRequest (member "") when a place (MOON_ME, m) is inside a closed object or, with `terrain`, inside a
// rock of its detail. A mesh that is open, or whose triangles do not all wind the same way, has no inside. `subject`
// says what is there, with a blank where something follows: "the camera". `terrain` may be null.
void refuse_enclosed(const dem::Terrain* terrain, const std::vector<SceneObject>& objects, const Vec3& place_m,
                     const std::string& subject, const StopToken& stop);
// The same for a camera: of the rows of a moving one, up to kMaxCameraPlaces.
inline constexpr std::size_t kMaxCameraPlaces = 16;
void refuse_enclosed(const dem::Terrain* terrain, const std::vector<SceneObject>& objects, const RowViews& views,
                     const StopToken& stop);

}  // namespace selenograph::engine
