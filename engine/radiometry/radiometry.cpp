#include "engine/radiometry/radiometry.h"

#include <cmath>
#include <numbers>

#include "dem/base/error.h"
#include "engine/radiometry/atmosphere.h"
#include "engine/radiometry/photometry.h"

namespace selenograph::engine {
namespace {

constexpr double kStefanBoltzmann_w_m2_k4 = 5.670374419e-8;  // CODATA 2018

// Returns B(T), W m-2 sr-1, in the band or over all wavelengths.
double blackbody(const FrameRequest& request, double temperature_k) {
  if (request.band) return planck_w_m2_sr(*request.band, temperature_k);
  return kStefanBoltzmann_w_m2_k4 * std::pow(temperature_k, 4) / std::numbers::pi;
}

}  // namespace

std::vector<std::string_view> RadianceTerms::names() const {
  std::vector<std::string_view> names{"direct"};
  if (indirect) names.push_back("indirect");
  if (scattered) names.push_back("scattered");
  if (emitted) names.push_back("emitted");
  if (thermal_path) names.push_back("thermal_path");
  return names;
}

RadianceTerms radiance_terms(const FrameRequest& request, const Material& material) {
  const double sunlight = 1 / (request.sun.distance_au * request.sun.distance_au);
  const double emissivity = 1 - material.reflectance.rho;  // eq. (3)
  RadianceTerms terms;
  if (request.atmosphere) {
    if (!request.band) throw ImpossibleRequest("an atmosphere needs a band");
    const Atmosphere::InBand in = request.atmosphere->over(*request.band, material.temperature_k);
    terms.direct_w_m2 = sunlight * in.direct_w_m2;  // eq. (2)
    terms.indirect = sunlight * in.indirect_w_m2_sr;
    terms.scattered = sunlight * in.scattered_w_m2_sr;
    terms.thermal_path = in.thermal_path_w_m2_sr;
    if (material.temperature_k > 0) terms.emitted = in.emitted_w_m2_sr * emissivity;  // eq. (3)
    return terms;
  }
  // tau = 1
  terms.direct_w_m2 =
      sunlight * (request.band ? solar_irradiance_w_m2(*request.band) : kSolarConstant_w_m2);               // eq. (2)
  if (material.temperature_k > 0) terms.emitted = blackbody(request, material.temperature_k) * emissivity;  // eq. (3)
  return terms;
}

}  // namespace selenograph::engine
