// Brightness of the whole Moon by reflectance models, compared with published models of its irradiance.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "engine/frame/request.h"
#include "engine/radiometry/brdf.h"
#include "engine/renderer.h"

namespace selenograph::engine {

// Returns the disc-equivalent reflectance of a smooth sphere, integrated over its surface (midpoint rule, to 1e-4).
double sphere_reflectance(const Brdf& brdf, double phase_deg);

struct DiscRow {
  std::string preset, ground;       // ground: "sphere" or "terrain"
  double wavelength_um, phase_deg;  // phase positive when waxing, negative when waning
  double reflectance;
  double rolo, lime;  // NaN where the models have no band or are not valid
};

// Returns the named reflectance models on a sphere, in the bands of ROLO and LIME, at phase angles from 2 to 97
// degrees.
std::vector<DiscRow> discs_on_sphere();

// Measures frames of the whole Moon from 384 400 km over the mean Earth meridian, with the request's surface, in LIME's
// band at 0.675 um: terrain has the same effect at all wavelengths. Throws as Renderer::render does.
std::vector<DiscRow> discs_on_terrain(const Renderer& renderer, const FrameRequest& surface, int size_px);

// Brightness of terrain seen from straight above, relative to that of smooth ground. The reflectance was fitted to the
// real Moon and includes its slopes and shadows already: this ratio shows how much terrain counts them twice.
struct ReliefRow {
  double incidence_deg, ratio, shadowed;  // shadowed: share of the pixels
  double post_spacing_m;
};
std::vector<ReliefRow> relief_at(const Renderer& renderer, const FrameRequest& surface, const Geographic& center,
                                 double width_m, int size_px);

}  // namespace selenograph::engine
