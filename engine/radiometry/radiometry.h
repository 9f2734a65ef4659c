// At-sensor radiance as the sum of its components: SENSOR++ (Paproth et al.), equations (1) to (3). What no member of a
// request asks for isn't evaluated.
#pragma once

#include "engine/frame/report.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

// Throws ImpossibleRequest for an atmosphere without a band or with one that reaches beyond
// its table.
RadianceTerms radiance_terms(const FrameRequest& request, const Material& material);
// Of the terrain.
inline RadianceTerms radiance_terms(const FrameRequest& request) {
  return radiance_terms(request, {request.reflectance, request.temperature_k});
}

}  // namespace selenograph::engine
