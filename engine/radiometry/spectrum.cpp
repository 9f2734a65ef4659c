#include "engine/radiometry/spectrum.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "engine/radiometry/photometry.h"
#include "engine/radiometry/solar_spectrum.h"
#include "engine/support/interpolate.h"

namespace selenograph::engine {
namespace {

// Integrates by Gauss-Legendre with eight points; exact for polynomials of degree 15.
template <typename Function>
double gauss(double from, double to, const Function& f) {
  constexpr double kAt[4] = {0.1834346424956498, 0.5255324099163290, 0.7966664774136267, 0.9602898564975363};
  constexpr double kWeight[4] = {0.3626837833783620, 0.3137066458778873, 0.2223810344533745, 0.1012285362903763};
  const double middle = (from + to) / 2, half = (to - from) / 2;
  double sum = 0;
  for (int i = 0; i < 4; ++i) sum += kWeight[i] * (f(middle - half * kAt[i]) + f(middle + half * kAt[i]));
  return sum * half;
}

}  // namespace

double planck_w_m2_sr_um(double wavelength_um, double temperature_k) {
  if (!(temperature_k > 0)) return 0;
  const double m = wavelength_um * 1e-6;
  const double x = kPlanck_j_s * kSpeedOfLight_m_s / (m * kBoltzmann_j_k * temperature_k);
  if (x > 700) return 0;
  // 2 h c^2 / lambda^5 / (exp(x) - 1) per metre; 1e-6 of that per micrometre
  return 1e-6 * 2 * kPlanck_j_s * kSpeedOfLight_m_s * kSpeedOfLight_m_s / (m * m * m * m * m) / std::expm1(x);
}

double solar_irradiance_w_m2(const Band& band) {
  static const std::vector<double> table = [] {
    std::vector<double> wavelengths;
    for (const SpectralSample& s : astm_e490()) wavelengths.push_back(s.wavelength_um);
    return wavelengths;
  }();
  const std::vector<double> points = band.breakpoints(table);
  double sum = 0;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const double from = points[i], to = points[i + 1];
    if (from < table.front() || to > table.back()) continue;
    sum += integral_of_product(to - from, band.response_at(from), band.response_at(to), solar_irradiance_w_m2_um(from),
                               solar_irradiance_w_m2_um(to));
  }
  return sum;
}

double integrate_planck(const std::vector<double>& breakpoints_um, double temperature_k,
                        const std::function<double(double)>& weight) {
  if (!(temperature_k > 0)) return 0;
  double sum = 0;
  for (std::size_t i = 0; i + 1 < breakpoints_um.size(); ++i) {
    const double first = breakpoints_um[i], last = breakpoints_um[i + 1];
    // Let B change by a moderate factor within a piece: half an octave of wavelength, less where exp(-x) is steep.
    const double x = kPlanck_j_s * kSpeedOfLight_m_s * 1e6 / (first * kBoltzmann_j_k * temperature_k);
    const double octaves = std::log2(last / first);
    const int pieces = static_cast<int>(std::clamp(std::ceil(octaves * (2 + x / 4)), 1.0, 4096.0));
    const double ratio = std::exp2(octaves / pieces);
    double from = first;
    for (int k = 0; k < pieces; ++k) {
      const double to = k + 1 == pieces ? last : from * ratio;
      sum += gauss(from, to, [&](double w) { return weight(w) * planck_w_m2_sr_um(w, temperature_k); });
      from = to;
    }
  }
  return sum;
}

double planck_w_m2_sr(const Band& band, double temperature_k) {
  return integrate_planck(band.breakpoints(), temperature_k, [&band](double w) { return band.response_at(w); });
}

Band in_photons(const Band& band, const std::vector<ResponsePoint>& efficiency) {
  std::vector<double> table;
  table.reserve(efficiency.size());
  for (const ResponsePoint& p : efficiency) table.push_back(p.wavelength_um);
  const std::vector<double> points = band.breakpoints(table);
  // Approximate products of linear functions by many linear pieces. At a step of the efficiency, both sides are
  // sampled.
  const std::size_t pieces = std::clamp<std::size_t>(2048 / points.size(), 1, 128);
  const auto counted = [&](double wavelength_um, double beside_um) {
    double eta = 1;
    if (!efficiency.empty()) {
      eta = 0;
      if (beside_um >= efficiency.front().wavelength_um && beside_um <= efficiency.back().wavelength_um) {
        const auto s = segment_at(
            efficiency, std::clamp(wavelength_um, efficiency.front().wavelength_um, efficiency.back().wavelength_um),
            &ResponsePoint::wavelength_um);
        eta = s.between(s.a.response, s.b.response);
      }
    }
    return band.response_at(wavelength_um) * eta * wavelength_um / band.center_um();
  };
  std::vector<ResponsePoint> response;
  constexpr double kStep = 1e-9;  // width of a step, as a share of the wavelength
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const double from = points[i], to = points[i + 1], middle = (from + to) / 2;
    for (std::size_t k = 0; k <= pieces; ++k) {
      const double share = static_cast<double>(k) / static_cast<double>(pieces);
      double at = from + share * (to - from);
      if (k == 0 && i > 0) at = std::min(from * (1 + kStep), middle);
      at = std::clamp(at, from, to);
      // Skip a step between ends of the band and the efficiency that differ only by rounding.
      if (response.empty() || at > response.back().wavelength_um) response.push_back({at, counted(at, middle)});
    }
  }
  return Band(std::move(response));
}

double photon_wavelength_um(const Band& band, const std::vector<ResponsePoint>& efficiency,
                            const std::function<double(const Band&)>& light_w_m2) {
  const Band counted = in_photons(band, efficiency);
  const double light = light_w_m2(band);
  if (!(light > 0)) return band.center_um() * counted.width_um() / band.width_um();
  return band.center_um() * light_w_m2(counted) / light;
}

}  // namespace selenograph::engine
