// Spectral bands and the integrals over them: SENSOR++ (Paproth et al.), section 2.2, the spectral quantities in
// equations (2) and (3). Wavelengths in micrometres, spectral quantities per micrometre.
#pragma once

#include <functional>
#include <vector>

namespace selenograph::engine {

// CODATA 2018; exact since the SI of 2019.
inline constexpr double kPlanck_j_s = 6.62607015e-34;
inline constexpr double kSpeedOfLight_m_s = 299792458.0;
inline constexpr double kBoltzmann_j_k = 1.380649e-23;

// B(T) of eq. (3): spectral radiance of a blackbody, W m-2 sr-1 um-1. 0 at 0 K.
double planck_w_m2_sr_um(double wavelength_um, double temperature_k);

// Integral of weight(wavelength) B(T), W m-2 sr-1, to 1e-10 of itself for a weight that is a polynomial of low degree
// between the breakpoints, which rise.
double integrate_planck(const std::vector<double>& breakpoints_um, double temperature_k,
                        const std::function<double(double)>& weight);

struct ResponsePoint {
  double wavelength_um;
  double response;  // 0 to 1
};

// A spectral channel: linear between the points of its response curve, 0 outside of it.
class Band {
 public:
  // Response 1 from center - width / 2 to center + width / 2. Throws std::invalid_argument unless 0 < width < 2 center.
  Band(double center_um, double width_um);
  // Throws std::invalid_argument unless there are two points or more at rising wavelengths above 0, none of whose
  // responses is negative and not all 0.
  explicit Band(std::vector<ResponsePoint> response);

  const std::vector<ResponsePoint>& response() const { return response_; }
  // The response's centre of gravity, and its integral: what eqs. (8) and (9) call lambda and Delta lambda.
  double center_um() const { return center_um_; }
  double width_um() const { return width_um_; }
  double response_at(double wavelength_um) const;
  // The curve's wavelengths and those of a table that lie between them, rising.
  std::vector<double> breakpoints(const std::vector<double>& table_um = {}) const;

  // Integral of E_sun over the band at 1 au, W m-2: exact for the table, which is linear in between.
  double solar_irradiance_w_m2() const;
  // Integral of B(T) over the band, W m-2 sr-1.
  double planck_w_m2_sr(double temperature_k) const;

 private:
  void measure();

  std::vector<ResponsePoint> response_;
  double center_um_ = 0, width_um_ = 0;
};

}  // namespace selenograph::engine
