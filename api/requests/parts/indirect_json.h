// "indirect": light from the terrain around and from the Earth.
#pragma once

#include <optional>

#include "api/schema/members.h"
#include "engine/frame/indirect.h"

namespace selenograph::api {

struct EarthForm {
  std::optional<Vec3> direction;
  std::optional<Geographic> sub_earth;
  std::optional<double> distance_m;
};
const Members<engine::IndirectLight>& indirect_members();

}  // namespace selenograph::api
