// Reflectance models and materials: SENSOR++ (Paproth et al.), sections 2.2 and 3.1, and two models of planetary
// photometry.
#pragma once

#include <optional>

namespace selenograph::engine {

enum class ReflectanceModel {
  lambert,                  // rho / pi                                           paper eq. (4)
  lommel_seeliger,          // rho / (2 pi) / (mu0 + mu)                          paper eq. (10)
  lommel_seeliger_lambert,  // "lunar": w * Lommel-Seeliger + (1 - w) * Lambert   paper 3.1
  blinn_phong,              // normalised by its exponent                         paper eq. (11)
  lunar_lambert,            // rho / pi (2 L / (mu0 + mu) + 1 - L)                McEwen 1991
  hapke,                    // with the opposition surge and macroscopic roughness  Hapke 1984, 2002
  moon                      // the Moon's own, in absolute units (engine/radiometry/moon.h)
};

// Ground of `moon`: the mean of the near side, or ground that is darker or brighter by wavelength.
enum class MoonGround { mean, mare, highlands };

// Phase law of Lommel-Seeliger and lunar-Lambert, which have none of their own: a factor f(g) of the phase angle g,
// with f(0) = 1, such that the integrated light of a uniform sphere follows that of the whole Moon
// (engine/radiometry/phase_law.h).
enum class PhaseLaw {
  none,   // f = 1, as in the paper
  allen,  // the Moon's magnitudes in the visible, 0 to 150 degrees: Allen 1973
  rolo    // the Moon's reflectance at 0.554 um with the opposition surge, 1.55 to 97 degrees: Kieffer & Stone 2005
};

// Single-particle phase function p(g), normalised to 4 pi over all directions.
enum class PhaseFunction {
  legendre,                 // 1 + b cos g + c (3 cos^2 g - 1) / 2
  double_henyey_greenstein  // a lobe back to the Sun of weight (1 + c) / 2 and one forward of (1 - c) / 2, both of
                            // width b
};

// Terms of Hapke's model. 1984 (and 1981): isotropic multiple scattering, H with an error of 4 %. 2002 (Icarus 157,
// 523): multiple scattering by p(g), H with an error of 1 %, coherent backscatter.
enum class HapkeTerms { terms_1984, terms_2002 };

// Defaults: the whole Moon in the visible, Helfenstein & Veverka (Icarus 72, 342, 1987), table II, whose S(0) = 0.71
// equals b0 w p(0).
struct HapkeParameters {
  double w = 0.21;   // single-scattering albedo
  double b0 = 2.01;  // amplitude of the opposition surge
  double h = 0.07;   // angular width of the opposition surge
  PhaseFunction phase_function = PhaseFunction::legendre;
  double b = 0.29, c = 0.39;
  double theta_bar_deg = 20;  // mean slope of the roughness below the mesh's resolution
  HapkeTerms terms = HapkeTerms::terms_1984;
  double bc0 = 0, hc = 0.1;  // terms_2002: amplitude and angular width of coherent backscatter
};

struct Reflectance {
  ReflectanceModel model = ReflectanceModel::lommel_seeliger_lambert;
  double lommel_seeliger_weight = 1.0;  // w of lommel_seeliger_lambert
  double rho = 0.12;                    // all models but hapke and moon
  double shininess = 100;               // p of blinn_phong
  // L of lunar_lambert. Empty: the Moon's, 1 - 0.019 g + 0.242e-3 g^2 - 1.46e-6 g^3, not below 0, g: phase angle in
  // degrees (McEwen, LPSC XXVII, 841, 1996).
  std::optional<double> limb_darkening{};
  PhaseLaw phase = PhaseLaw::none;  // for lommel_seeliger, lommel_seeliger_lambert, lunar_lambert
  HapkeParameters hapke{};
  MoonGround ground = MoonGround::mean;  // ground of the model `moon`
};

// Returns false for models without a rho, which emission, B(T) (1 - rho), requires.
inline bool has_rho(ReflectanceModel model) {
  return model != ReflectanceModel::hapke && model != ReflectanceModel::moon;
}

// Reflectance and temperature of a surface.
struct Material {
  Reflectance reflectance;
  double temperature_k = 0;  // 0: no thermal emission
};

}  // namespace selenograph::engine
