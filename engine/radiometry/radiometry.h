// At-sensor radiance as the sum of its components: SENSOR++ (Paproth et al.), equations (1) to (3). Components that the
// request does not ask for are not evaluated.
#pragma once

#include "engine/frame/report.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

// Returns the components for a material. Throws ImpossibleRequest for an atmosphere without a band, or with a band that
// extends beyond its table.
RadianceTerms radiance_terms(const FrameRequest& request, const Material& material);
// Returns the components for the terrain.
inline RadianceTerms radiance_terms(const FrameRequest& request) {
  return radiance_terms(request, {request.reflectance, request.temperature_k});
}

}  // namespace selenograph::engine
