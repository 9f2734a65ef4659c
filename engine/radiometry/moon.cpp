#include "engine/radiometry/moon.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "engine/radiometry/disc_models.h"
#include "engine/radiometry/hapke.h"
#include "engine/radiometry/sato2014.h"
#include "engine/radiometry/solar_spectrum.h"

namespace selenograph::engine {
namespace {

constexpr std::size_t kNodes = 10;
// Wavelengths between which the spectrum is linear: means of ROLO's bands, LIME's six, means of ROLO's bands.
constexpr std::array<double, kNodes> kNodes_um{0.3525, 0.4106, 0.44, 0.5, 0.675, 0.87, 1.02, 1.64, 1.9815, 2.31725};
constexpr std::size_t kFirstLime = 2, kLastLime = 7;
// ROLO's bands of the nodes that are not LIME's. The one at 2.126 um is odd as published, and is left out.
constexpr std::array<std::array<double, 3>, kNodes> kRoloBands_um{
    {{0.3500, 0.3551}, {0.4050, 0.4123, 0.4144}, {}, {}, {}, {}, {}, {}, {1.9815}, {2.2509, 2.3836}}};

// Returns ROLO's reflectance; beyond its last phase angle in proportion to Allen's law.
double rolo(double wavelength_um, double phase_deg) {
  const double fitted_deg = std::min(phase_deg, kRoloLast_deg);
  return disc_reflectance_at(DiscModel::rolo, wavelength_um, {fitted_deg}) *
         (moon_light(PhaseLaw::allen, phase_deg) / moon_light(PhaseLaw::allen, fitted_deg));
}

// Returns LIME's reflectance at one of its wavelengths; outside its phase angles in proportion to ROLO's.
double lime(std::size_t node, double phase_deg) {
  const double fitted_deg = std::clamp(phase_deg, kLimeFirst_deg, kLimeLast_deg);
  return disc_reflectance(DiscModel::lime, node - kFirstLime, {fitted_deg}) *
         (rolo(kNodes_um[node], phase_deg) / rolo(kNodes_um[node], fitted_deg));
}

// Returns the reflectance at a node: LIME's, or the mean of ROLO's bands scaled to LIME's at the nearer end.
double node_reflectance(std::size_t node, double phase_deg) {
  if (node >= kFirstLime && node <= kLastLime) return lime(node, phase_deg);
  const std::size_t end = node < kFirstLime ? kFirstLime : kLastLime;
  double sum = 0;
  int bands = 0;
  for (const double band_um : kRoloBands_um[node])
    if (band_um > 0) {
      sum += rolo(band_um, phase_deg);
      ++bands;
    }
  // ROLO's band at LIME's first or last wavelength is a few nanometres off.
  const double joined_um = end == kFirstLime ? 0.4416 : 1.6336;
  return sum / bands * (lime(end, phase_deg) / rolo(joined_um, phase_deg));
}

// Disc-equivalent reflectance A of each node at the knots of TermsByPhase.
using AtKnots = std::array<std::vector<double>, kNodes>;
const AtKnots& reflectances_at_knots() {
  static const AtKnots table = [] {
    AtKnots out;
    for (std::size_t node = 0; node < kNodes; ++node)
      for (int i = 0; i <= TermsByPhase::kIntervals; ++i)
        out[node].push_back(node_reflectance(node, TermsByPhase::knot_phase_deg(i)));
    return out;
  }();
  return table;
}

// Returns the brightness of mare or highlands over the mean of the near side, by Sato's Hapke parameters at incidence
// and phase 30 degrees, seen from the zenith.
double ground_ratio(MoonGround ground, double wavelength_um) {
  if (ground == MoonGround::mean) return 1;
  const auto brightness = [&](SatoRegion region) {
    const HapkeLaw law(sato2014(region, wavelength_um));
    const double cosine = std::cos(30 * kRadiansPerDegree);
    return law.with_kind([&]<bool kLegendre, bool kOf2002>() {
      return law.times_mu0<ScalarMath, kLegendre, kOf2002>(cosine, 1, cosine, law.albedo());
    });
  };
  return brightness(ground == MoonGround::mare ? SatoRegion::mare : SatoRegion::highlands) /
         brightness(SatoRegion::near_side);
}

// Position of a wavelength among the nodes.
struct NodePosition {
  std::size_t node;
  double share;  // share of the next node
};
NodePosition position_of(double wavelength_um) {
  const double clamped_um = std::clamp(wavelength_um, kNodes_um.front(), kNodes_um.back());
  const auto next = std::upper_bound(kNodes_um.begin() + 1, kNodes_um.end() - 1, clamped_um);
  const auto node = static_cast<std::size_t>(next - kNodes_um.begin()) - 1;
  return {node, (clamped_um - kNodes_um[node]) / (kNodes_um[node + 1] - kNodes_um[node])};
}

// Returns a band of response 1 over the solar spectrum's table.
const Band& all_wavelengths() {
  static const Band band({{astm_e490().front().wavelength_um, 1}, {astm_e490().back().wavelength_um, 1}});
  return band;
}

// Returns the wavelengths at which a band's response, the Sun's spectrum or the nodes' shares bend, inside the Sun's
// table.
std::vector<double> bends_of(const Band& band) {
  std::vector<double> table(kNodes_um.begin(), kNodes_um.end());
  for (const SpectralSample& sample : astm_e490()) table.push_back(sample.wavelength_um);
  std::sort(table.begin(), table.end());
  std::vector<double> bends = band.breakpoints(table);
  std::erase_if(
      bends, [](double um) { return um < astm_e490().front().wavelength_um || um > astm_e490().back().wavelength_um; });
  return bends;
}

// Integrals of E_sun times the response times each node's share, W m-2 at 1 au. Between two bends all three are linear,
// so Simpson's rule is exact.
using Weights = std::array<double, kNodes>;
Weights weights_of(const Band& band) {
  const std::vector<double> bends = bends_of(band);
  Weights weights{};
  for (std::size_t i = 0; i + 1 < bends.size(); ++i) {
    const double from = bends[i], to = bends[i + 1], middle = (from + to) / 2;
    const std::size_t node = position_of(middle).node;
    const std::array<std::pair<double, double>, 3> points{{{from, 1.0}, {middle, 4.0}, {to, 1.0}}};
    for (const auto& [at, simpson] : points) {
      const double light = simpson * (to - from) / 6 * band.response_at(at) * solar_irradiance_w_m2_um(at);
      const double clamped_um = std::clamp(at, kNodes_um.front(), kNodes_um.back());
      const double share = (clamped_um - kNodes_um[node]) / (kNodes_um[node + 1] - kNodes_um[node]);
      weights[node] += light * (1 - share);
      weights[node + 1] += light * share;
    }
  }
  return weights;
}

// Returns the weights of a band; of all wavelengths without a band.
Weights weights_of(const Band* band) {
  static const Weights of_all_wavelengths = weights_of(all_wavelengths());
  return band ? weights_of(*band) : of_all_wavelengths;
}

double sum_of(const Weights& weights) {
  double sum = 0;
  for (const double weight : weights) sum += weight;
  return sum;
}

}  // namespace

double moon_reflectance(MoonGround ground, double wavelength_um, double phase_deg) {
  const auto [node, share] = position_of(wavelength_um);
  const auto at = [&](std::size_t k) { return node_reflectance(k, phase_deg) * ground_ratio(ground, kNodes_um[k]); };
  return std::lerp(at(node), at(node + 1), share);
}

TermsByPhase moon_terms(MoonGround ground, const Band* band) {
  Weights weights = weights_of(band);
  const double sum = sum_of(weights);
  for (std::size_t k = 0; k < kNodes; ++k) weights[k] *= ground_ratio(ground, kNodes_um[k]) / (sum > 0 ? sum : 1.0);
  const AtKnots& reflectances = reflectances_at_knots();
  std::vector<BrdfTerms> knots;
  for (int i = 0; i <= TermsByPhase::kIntervals; ++i) {
    double reflectance = 0;
    for (std::size_t k = 0; k < kNodes; ++k) reflectance += weights[k] * reflectances[k][static_cast<std::size_t>(i)];
    const double phase_deg = TermsByPhase::knot_phase_deg(i);
    const double l = mcewen_limb_darkening(phase_deg);
    const BrdfTerms shape{2 * l, 1 - l};
    const double c = reflectance / (std::numbers::pi * sphere_light(shape, phase_deg));
    knots.push_back({c * shape.lommel_seeliger, c * shape.lambert});
  }
  return TermsByPhase(knots);
}

double moonlight_w_m2(MoonGround ground, const Band& band) {
  constexpr double kUsual_deg = 30;
  const Weights weights = weights_of(band);
  double sum = 0;
  for (std::size_t k = 0; k < kNodes; ++k)
    sum += weights[k] * ground_ratio(ground, kNodes_um[k]) * node_reflectance(k, kUsual_deg);
  return sum;
}

MoonTrust moon_trust(const Band* band) {
  constexpr double kFirst_um = 0.35, kLast_um = 2.5;
  const Band& response = band ? *band : all_wavelengths();
  double total = 0, measured = 0, by_lime = 0;
  const std::vector<double> bends = bends_of(response);
  for (std::size_t i = 0; i + 1 < bends.size(); ++i) {
    const double middle = (bends[i] + bends[i + 1]) / 2;
    const double light = response.response_at(middle) * solar_irradiance_w_m2_um(middle) * (bends[i + 1] - bends[i]);
    total += light;
    if (middle >= kFirst_um && middle <= kLast_um) measured += light;
    if (middle >= kNodes_um[kFirstLime] && middle <= kNodes_um[kLastLime]) by_lime += light;
  }
  if (!(total > 0)) return {kRoloUncertainty, 1};
  return {std::lerp(kRoloUncertainty, kLimeUncertainty, by_lime / total), 1 - measured / total};
}

std::optional<double> near_side_mean(const dem::ValueMap& map, const StopToken& stop) {
  return map.once([&]() -> std::optional<double> {
    constexpr int kAcross = 128;
    constexpr double kPhase_deg = 45, kMinCoverage = 0.95;
    constexpr double kSide_m = 2 * kMoonRadius_m / kAcross;
    const double l = mcewen_limb_darkening(kPhase_deg);
    const BrdfTerms terms{2 * l, 1 - l};
    dem::ValueMap::Sampler sampler(map, stop);
    double sum = 0, covered = 0, total = 0;
    // Integrate over the disc as viewed from the mean Earth: x toward it, y east, z north.
    for (int row = 0; row < kAcross; ++row)
      for (int column = 0; column < kAcross; ++column) {
        const double z = 1 - (2 * row + 1.0) / kAcross, y = (2 * column + 1.0) / kAcross - 1, x2 = 1 - y * y - z * z;
        if (!(x2 > 0)) continue;
        const double x = std::sqrt(x2);
        // Light from both sides, as before and after full Moon, weights east and west equally.
        double weight = 0;
        for (const double side : {1.0, -1.0}) {
          const double mu0 =
              x * std::cos(kPhase_deg * kRadiansPerDegree) + side * y * std::sin(kPhase_deg * kRadiansPerDegree);
          if (mu0 > 0) weight += terms.times_mu0(mu0, x);
        }
        const double lat_deg = std::asin(z) / kRadiansPerDegree, lon_deg = std::atan2(y, x) / kRadiansPerDegree;
        const auto [value, coverage] = sampler.mean({lat_deg, lon_deg, {kSide_m, 0}, {0, kSide_m}});
        total += weight;
        if (coverage > 0) {
          sum += weight * coverage * value;
          covered += weight * coverage;
        }
      }
    return covered >= kMinCoverage * total && sum > 0 ? std::optional(sum / covered) : std::nullopt;
  });
}

}  // namespace selenograph::engine
