#include "engine/sensor/spectrometer.h"

#include "engine/radiometry/spectrum.h"
#include "engine/sensor/detector.h"
#include "engine/support/interpolate.h"

namespace selenograph::engine {
std::vector<SpectrometerChannel> look_at_blackbody(const Spectrometer& s, double temperature_k, const StopToken& stop) {
  std::vector<SpectrometerChannel> channels;
  const double width = (s.last_um - s.first_um) / s.channels;
  for (int i = 0; i < s.channels; ++i) {
    stop.check();
    SpectrometerChannel c{};
    c.center_um = s.first_um + (i + 0.5) * width;
    c.width_um = width;
    c.efficiency =
        interpolated(s.efficiency, c.center_um, &EfficiencyPoint::wavelength_um, &EfficiencyPoint::efficiency);
    c.radiance_w_m2_sr_um = planck_w_m2_sr_um(c.center_um, temperature_k);                                 // eq. (3)
    c.flux_w = radiant_flux_w(s.pixel_pitch_um, s.f_number, c.efficiency, c.radiance_w_m2_sr_um * width);  // eq. (9)
    c.signal_to_noise = signal_to_noise(c.flux_w, s.noise_equivalent_power_w);                             // eq. (12)
    const double integral = planck_w_m2_sr(Band(c.center_um, width), temperature_k);
    c.width_error = integral > 0 ? c.radiance_w_m2_sr_um * width / integral - 1 : 0;
    channels.push_back(c);
  }
  return channels;
}

}  // namespace selenograph::engine
