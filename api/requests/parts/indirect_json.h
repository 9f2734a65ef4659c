// "indirect": sunlight reflected by the surrounding terrain, and light from the Earth.
#pragma once

#include <optional>

#include "api/schema/members.h"
#include "engine/frame/indirect.h"

namespace selenograph::api {

// "indirect.earth" as a client writes it; without a direction, the Earth is where it is at the Sun's epoch.
struct EarthForm {
  std::optional<Vec3> direction;
  std::optional<Geographic> sub_earth;
  std::optional<double> distance_m;
};
const Members<engine::IndirectLight>& indirect_members();

}  // namespace selenograph::api
