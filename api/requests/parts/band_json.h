// "band": the spectral channel that radiance is integrated over, a rectangle or a curve.
#pragma once

#include <optional>
#include <vector>

#include "api/schema/members.h"
#include "engine/frame/band.h"

namespace selenograph::api {

// "band" as a client writes it: a rectangle by its centre and width, or a response curve.
struct BandForm {
  std::optional<double> center_um, width_um;
  std::optional<std::vector<engine::ResponsePoint>> response;
};
const Members<BandForm, engine::Band>& band_members();

}  // namespace selenograph::api
