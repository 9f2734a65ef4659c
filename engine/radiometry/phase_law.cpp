#include "engine/radiometry/phase_law.h"

#include <algorithm>
#include <numbers>

#include "dem/grid/geodesy.h"
#include "engine/radiometry/disc_models.h"

namespace selenograph::engine {
namespace {

constexpr double kPi = std::numbers::pi;

// Returns Allen's law, constant beyond its last observed phase angle.
double allen(double phase_deg) {
  const double observed_deg = std::min(phase_deg, kAllenLast_deg);
  return std::pow(10, -0.4 * (0.026 * observed_deg + 4e-9 * std::pow(observed_deg, 4)));
}

// Returns ROLO's law relative to phase 0; beyond its last phase angle in proportion to Allen's.
double rolo(double phase_deg) {
  constexpr double kBand_um = 0.5538;
  const double observed_deg = std::min(phase_deg, kRoloLast_deg);
  return disc_reflectance_at(DiscModel::rolo, kBand_um, {observed_deg}) /
         disc_reflectance_at(DiscModel::rolo, kBand_um, {0}) * (allen(phase_deg) / allen(observed_deg));
}

// Returns the constants without the phase law.
BrdfTerms plain_terms_at(const Reflectance& r, double phase_deg) {
  const double seeliger = r.rho / (2 * kPi);  // eq. (10)
  const double lambert = r.rho / kPi;         // eq. (4)
  const double w = r.lommel_seeliger_weight;
  // No switch here: models with their own equations (brdf.cpp) have no such constants and need no case.
  if (r.model == ReflectanceModel::lommel_seeliger) return {seeliger, 0};
  if (r.model == ReflectanceModel::lommel_seeliger_lambert) return {w * seeliger, (1 - w) * lambert};  // section 3.1
  if (r.model != ReflectanceModel::lunar_lambert) return {0, lambert};
  const double l = r.limb_darkening ? *r.limb_darkening : mcewen_limb_darkening(phase_deg);
  return {2 * l * lambert, (1 - l) * lambert};
}

// Computes the cubic through four consecutive values, as powers of x from 0 to 1. `from`: position of the first value
// relative to x = 0.
void cubic(const double* y, double from, double* out) {
  // Newton's form in s = x - from.
  const double d1 = y[1] - y[0], d2 = (y[2] - 2 * y[1] + y[0]) / 2, d3 = (y[3] - 3 * y[2] + 3 * y[1] - y[0]) / 6;
  const double a1 = d1 - d2 + 2 * d3, a2 = d2 - 3 * d3, t = -from;
  out[0] = y[0] + t * (a1 + t * (a2 + t * d3));
  out[1] = a1 + t * (2 * a2 + 3 * t * d3);
  out[2] = a2 + 3 * t * d3;
  out[3] = d3;
}

}  // namespace

double mcewen_limb_darkening(double g) { return std::max(0.0, 1 + g * (-0.019 + g * (0.242e-3 - g * 1.46e-6))); }

double lommel_seeliger_sphere(double phase_deg) {
  if (phase_deg <= 0) return 1;
  if (phase_deg >= 180) return 0;
  const double half = phase_deg * kRadiansPerDegree / 2;
  return 1 + std::sin(half) * std::tan(half) * std::log(std::tan(half / 2));
}

double lambert_sphere(double phase_deg) {
  const double g = phase_deg * kRadiansPerDegree;
  return 2 / (3 * kPi) * (std::sin(g) + (kPi - g) * std::cos(g));
}

double sphere_light(const BrdfTerms& terms, double phase_deg) {
  return terms.lommel_seeliger / 2 * lommel_seeliger_sphere(phase_deg) + terms.lambert * lambert_sphere(phase_deg);
}

double moon_light(PhaseLaw law, double phase_deg) {
  switch (law) {
    case PhaseLaw::allen:
      return allen(phase_deg);
    case PhaseLaw::rolo:
      return rolo(phase_deg);
    case PhaseLaw::none:
      break;
  }
  return 1;
}

double TermsByPhase::knot_phase_deg(int knot) {
  return 2 * std::asin(kLastSine * knot / kIntervals) / kRadiansPerDegree;
}

TermsByPhase::TermsByPhase(const std::vector<BrdfTerms>& knots) : cubics_(kCoefficients * kIntervals) {
  for (int i = 0; i < kIntervals; ++i) {
    const int first = std::clamp(i - 1, 0, kIntervals - 3);
    double seeliger[4], lambert[4];
    for (int k = 0; k < 4; ++k) {
      const BrdfTerms& terms = knots.at(static_cast<std::size_t>(first + k));
      seeliger[k] = terms.lommel_seeliger;
      lambert[k] = terms.lambert;
    }
    double* const out = cubics_.data() + kCoefficients * i;
    cubic(seeliger, first - i, out);
    cubic(lambert, first - i, out + 4);
  }
}

TermsByPhase::TermsByPhase(const std::function<BrdfTerms(double)>& law)
    : TermsByPhase([&] {
        std::vector<BrdfTerms> knots;
        for (int i = 0; i <= kIntervals; ++i) knots.push_back(law(knot_phase_deg(i)));
        return knots;
      }()) {}

bool varies_by_phase(const Reflectance& r) {
  return r.phase != PhaseLaw::none || (r.model == ReflectanceModel::lunar_lambert && !r.limb_darkening);
}

BrdfTerms terms_at(const Reflectance& r, double phase_deg) {
  const BrdfTerms terms = plain_terms_at(r, phase_deg);
  if (r.phase == PhaseLaw::none) return terms;
  // Constant beyond 150 degrees, where McEwen's L is 0.
  const double observed_deg = std::min(phase_deg, kAllenLast_deg), sphere = sphere_light(terms, observed_deg);
  if (!(sphere > 0)) return terms;  // rho is 0
  const double f = moon_light(r.phase, observed_deg) * sphere_light(plain_terms_at(r, 0), 0) / sphere;
  return {terms.lommel_seeliger * f, terms.lambert * f};
}

}  // namespace selenograph::engine
