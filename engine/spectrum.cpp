#include "engine/spectrum.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>

#include "engine/interpolate.h"
#include "engine/photometry.h"
#include "engine/solar_spectrum.h"

namespace selenograph::engine {
namespace {

// Integral of a product of two linear functions by Simpson's rule: exact.
double integral_of_product(double width, double a0, double a1, double b0, double b1) {
  return width / 6 * (a0 * b0 + (a0 + a1) * (b0 + b1) + a1 * b1);
}

// Gauss-Legendre with eight points; exact for polynomials of degree 15.
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
  // 2 h c^2 / lambda^5 / (exp(x) - 1), per metre; 1e-6 of that per micrometre
  return 1e-6 * 2 * kPlanck_j_s * kSpeedOfLight_m_s * kSpeedOfLight_m_s / (m * m * m * m * m) / std::expm1(x);
}

Band::Band(double center_um, double width_um)
    : response_{{center_um - width_um / 2, 1}, {center_um + width_um / 2, 1}} {
  const double first = response_[0].wavelength_um, last = response_[1].wavelength_um;
  if (!(width_um > 0 && first > 0 && last > first))
    throw std::invalid_argument("a band's width must be above 0 and below twice its center");
  measure();
}

Band::Band(std::vector<ResponsePoint> response) : response_(std::move(response)) {
  if (response_.size() < 2) throw std::invalid_argument("a response curve needs two points");
  double before = 0;
  for (const ResponsePoint& p : response_) {
    if (!(p.wavelength_um > before))
      throw std::invalid_argument("a response curve's wavelengths must rise, from above 0");
    if (!(p.response >= 0)) throw std::invalid_argument("a response must not be negative");
    before = p.wavelength_um;
  }
  measure();
  if (!(width_um_ > 0)) throw std::invalid_argument("a response curve must not be 0 everywhere");
}

void Band::measure() {
  double moment = 0;
  for (std::size_t i = 0; i + 1 < response_.size(); ++i) {
    const ResponsePoint &a = response_[i], &b = response_[i + 1];
    const double width = b.wavelength_um - a.wavelength_um;
    width_um_ += width * (a.response + b.response) / 2;
    moment += integral_of_product(width, a.response, b.response, a.wavelength_um, b.wavelength_um);
  }
  center_um_ = moment / width_um_;
}

double Band::response_at(double wavelength_um) const {
  if (!(wavelength_um >= response_.front().wavelength_um && wavelength_um <= response_.back().wavelength_um)) return 0;
  const auto s = segment_at(response_, wavelength_um, &ResponsePoint::wavelength_um);
  return s.between(s.a.response, s.b.response);
}

std::vector<double> Band::breakpoints(const std::vector<double>& table_um) const {
  std::vector<double> points;
  for (const ResponsePoint& p : response_) points.push_back(p.wavelength_um);
  for (const double w : table_um)
    if (w > response_.front().wavelength_um && w < response_.back().wavelength_um) points.push_back(w);
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

double Band::solar_irradiance_w_m2() const {
  static const std::vector<double> table = [] {
    std::vector<double> wavelengths;
    for (const SpectralSample& s : kAstmE490) wavelengths.push_back(s.wavelength_um);
    return wavelengths;
  }();
  const std::vector<double> points = breakpoints(table);
  double sum = 0;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const double from = points[i], to = points[i + 1];
    if (from < table.front() || to > table.back()) continue;
    sum += integral_of_product(to - from, response_at(from), response_at(to), solar_irradiance_w_m2_um(from),
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
    // B changes by a moderate factor from piece to piece: half an octave of wavelength, less where exp(-x) is steep.
    const double x = kPlanck_j_s * kSpeedOfLight_m_s * 1e6 / (first * kBoltzmann_j_k * temperature_k);
    const double octaves = std::log2(last / first);
    const int pieces = std::clamp(static_cast<int>(std::ceil(octaves * (2 + x / 4))), 1, 4096);
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

double Band::planck_w_m2_sr(double temperature_k) const {
  return integrate_planck(breakpoints(), temperature_k, [this](double w) { return response_at(w); });
}

}  // namespace selenograph::engine
