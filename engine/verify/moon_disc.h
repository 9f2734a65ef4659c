// Brightness of the whole Moon as reflectance models have it, beside published models of its irradiance.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "engine/frame/request.h"
#include "engine/radiometry/brdf.h"
#include "engine/renderer.h"

namespace selenograph::engine {

// Disc-equivalent reflectance of a smooth sphere, by integration over its surface (midpoint rule, to 1e-4).
double sphere_reflectance(const Brdf& brdf, double phase_deg);

struct DiscRow {
  std::string preset, ground;       // ground: "sphere" or "terrain"
  double wavelength_um, phase_deg;  // phase positive when waxing, negative when waning
  double reflectance;
  double rolo, lime;  // NaN where the models have no band or are not valid
};

// The named reflectance models on a sphere, in the bands of ROLO and LIME, from 2 to 97 degrees.
std::vector<DiscRow> discs_on_sphere();

// Frames of the whole Moon from 384 400 km over the mean Earth meridian, with the request's surface, in LIME's band at
// 0.675 um: what terrain changes is the same at all wavelengths. Throws as Renderer::render does.
std::vector<DiscRow> discs_on_terrain(const Renderer& renderer, const FrameRequest& surface, int size_px);

// Brightness of terrain seen from straight above over that of smooth ground: what slopes and shadows add to a
// reflectance that was fitted to a Moon whose slopes and shadows it has already.
struct ReliefRow {
  double incidence_deg, ratio, shadowed;  // shadowed: share of the pixels
  double post_spacing_m;
};
std::vector<ReliefRow> relief_at(const Renderer& renderer, const FrameRequest& surface, const Geographic& center,
                                 double width_m, int size_px);

}  // namespace selenograph::engine
