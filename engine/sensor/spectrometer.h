// A thermal imaging spectrometer looking at a blackbody: SENSOR++ (Paproth et al.), sections 2.3 and 4, equations (3),
// (9) and (12), figure 6.
#pragma once

#include <vector>

#include "dem/base/stop_token.h"

namespace selenograph::engine {

struct EfficiencyPoint {
  double wavelength_um, efficiency;
};

// Defaults: MERTIS. The paper gives 80 channels from 7 to 14 um. Assumed, because the paper does not give them:
// channels of equal width; f/2 and 35 um (0.7 mrad behind 50 mm: Hiesinger, Helbert et al., Planet. Space Sci. 58, 144,
// 2010); an efficiency of optics and grating of 0.3 at all wavelengths; a noise-equivalent power of 1 pW after
// averaging over frames.
struct Spectrometer {
  double first_um = 7, last_um = 14;
  int channels = 80;
  double pixel_pitch_um = 35;
  double f_number = 2;
  std::vector<EfficiencyPoint> efficiency{{7, 0.3}};  // eta, linear in between, constant beyond
  double noise_equivalent_power_w = 1e-12;
};

struct SpectrometerChannel {
  double center_um, width_um, efficiency;
  double radiance_w_m2_sr_um;  // L = L_em = B(T): rho = 0, tau = 1
  double flux_w;               // Phi, eq. (9)
  double signal_to_noise;      // eq. (12)
  double width_error;          // relative error of L Delta lambda against the integral over the channel
};

// Returns the channels' view of a blackbody. Channels must be distinct from 0 and from each other in double precision:
// api/requests/mertis_json.cpp rejects others. Throws Cancelled when stopped.
std::vector<SpectrometerChannel> look_at_blackbody(const Spectrometer& spectrometer, double temperature_k,
                                                   const StopToken& stop = {});

}  // namespace selenograph::engine
