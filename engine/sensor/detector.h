// Radiance to electrons, flux and digital numbers: SENSOR++ (Paproth et al.), equations (8), (9) and (12).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/frame/sensor_model.h"

namespace selenograph::engine {

// Returns the electrons that a quantum detector counts in its integration time, paper eq. (8): n_el = t pi p^2 /
// (4 f_#^2) eta L lambda / (h c) Delta lambda, for L Delta lambda = 1 W m-2 sr-1 at wavelength lambda. The equation
// assumes Delta lambda << lambda; for a wide band lambda is photon_wavelength_um, or the band's center if the radiance
// is counted in photons (in_photons).
double electrons_per_radiance(const Optics& optics, const Detector& detector, double wavelength_um);

// Returns the radiant flux on a detector's pixel, W, paper eq. (9): Phi = pi / 4 p^2 / f_#^2 eta L Delta lambda.
// `radiance_w_m2_sr`: L Delta lambda; `efficiency`: eta, of optics, filters and, in a spectrometer, the grating.
double radiant_flux_w(double pixel_pitch_um, double f_number, double efficiency, double radiance_w_m2_sr);

// Returns paper eq. (12), for a bolometer with a noise-equivalent power.
inline double signal_to_noise(double flux_w, double noise_equivalent_power_w) {
  return flux_w / noise_equivalent_power_w;
}

// Returns the electrons at which a pixel holds `share` of its full well, or its digital number, offset included, is
// `share` of the largest; whichever is reached first. 0 or less if the offset alone is as much.
double filled_e(const Detector& detector, double share);
// Returns the electrons at which a pixel is full or its digital number is the largest.
inline double saturation_e(const Detector& detector) { return filled_e(detector, 1); }

// Returns the electrons that frame-transfer smear adds to each pixel of a column, equal for all rows; empty without
// smear. `per_radiance`: electrons_per_radiance() for any integration time; the result does not depend on that time.
// `radiance`: after the optics, as below.
std::vector<float> smear_e(const Detector& detector, double per_radiance, const std::vector<float>& radiance, int width,
                           int height);

// Returns the integration time, s, after which the metered pixels hold `target_e` electrons from light, smear and dark
// current, without noise, fixed pattern and full well. Negative if smear alone exceeds the target; 1e30 at most, if
// nothing fills the pixels.
double time_to_fill_s(const SensorModel& sensor, double wavelength_um, double target_e,
                      const std::vector<float>& radiance, int width, int height);

// Spills what pixels hold above the full well along their columns, half of it to either side, into the next pixels with
// room. Returns the electrons that leave the image at its first and last row; all others are kept. The room between two
// full runs is filled from the upper one first.
double bloom(double full_well_e, int width, int height, std::span<float> electrons);

struct ReadOut {
  double saturated_fraction = 0;  // share of pixels that are full or have the largest digital number
  double brightest_e = 0;         // electrons that light frees in the brightest pixel; without noise
  double smear_e = 0;             // maximum over all but the brightest thousandth of the columns
};

// Reads out a frame of width x height as digital numbers. `radiance`: after the optics. Parallel; the image does not
// depend on the number of threads. Throws Cancelled when stopped.
//   electrons = min(full well, bloom(Poisson((signal + smear) (1 + PRNU) + dark))) + DSNU + read noise
//   DN = clamp(round(electrons / gain + offset))
// Dead pixels have neither signal nor smear.
// `line`: all rows are the same line of pixels at different times and share one row's fixed pattern.
ReadOut detect(const SensorModel& sensor, double wavelength_um, const std::vector<float>& radiance, int width,
               int height, std::vector<std::uint16_t>& image, const StopToken& stop = {}, bool line = false);

}  // namespace selenograph::engine
