#include "dem/sample/landscape.h"

#include <cmath>

namespace selenograph::dem::sample {

// Sets a post's layers to the highlands: basins, and noise whose octaves go to the layers of craters of their size.
void Landscape::lay_highlands(const Vec3& p_m, Layers& layers) const {
  constexpr double kHighland_m = 1000, kBasinDepth_m = 3300;
  const double basin = smoothstep(0.0, 0.3, basin_field(p_m));
  layers.m[0] = static_cast<float>(kHighland_m - kBasinDepth_m * basin);
  // Add noise whose slopes fall slowly with scale: the Hurst exponent is 0.95 in the highlands (Rosenburg et al. 2011).
  // Stop at 250 m: below, regolith is smooth but for craters.
  constexpr double kHurst = 0.8, kAmplitude_m = 750;
  static const double kGain = std::exp2(-kHurst);
  double cell_m = 128e3, amplitude_m = kAmplitude_m;
  for (int i = 0; i < 10; ++i, cell_m /= 2, amplitude_m *= kGain) {
    const int layer = i < 2 ? 0 : layer_of_octave(i - 2);
    layers.m[static_cast<std::size_t>(layer)] +=
        static_cast<float>(amplitude_m * noise(p_m, cell_m, 10 + static_cast<std::uint64_t>(i)));
  }
}

// Returns the height of wrinkle ridges: broad low arches with a narrow wandering crest (Plescia & Golombek 1986), along
// the zero lines of a noise.
double Landscape::wrinkle_ridges_m(const Vec3& p_m) const {
  const double strength = smoothstep(0.0, 0.35, noise(p_m, 40e3, 41) + 0.15);
  if (strength <= 0) return 0;
  const double line = noise(p_m, 38e3, 42) + 0.05 * noise(p_m, 6e3, 43);
  const double crest = line + 0.025 * noise(p_m, 3.5e3, 44);
  const double arch_m = 120 * std::exp(-std::pow(line / 0.05, 2));
  const double crest_m = 45 * std::exp(-std::pow(crest / 0.012, 2)) * (1 + 0.5 * noise(p_m, 2e3, 45));
  return strength * (arch_m + crest_m);
}

// Fills basins with lava up to a level that depends on the position.
void Landscape::flood_maria(const Vec3& p_m, Layers& layers) const {
  constexpr double kMare_m = -1500, kShore_m = 10;
  const double field = basin_field(p_m);
  if (field < 0) return;
  double level_m = kMare_m - 4000 * (1 - smoothstep(0.0, 0.12, field));
  const double before_m = layers.sum();
  if (before_m > level_m + 400) return;  // dry, and far above the lava with its ridges
  level_m +=
      80 * noise(p_m, 90e3, 30) + 35 * noise(p_m, 25e3, 31) + 16 * noise(p_m, 7e3, 32) + 6 * noise(p_m, 2.2e3, 33);
  level_m += wrinkle_ridges_m(p_m);
  // Take the smooth maximum of ground and lava.
  const double above = (before_m - level_m) / kShore_m;
  const double after_m = level_m + kShore_m * (above > 30 ? above : std::log1p(std::exp(above)));
  // Move buried relief to layer 0, so that later craters cannot erase it. Do so gradually with depth: an edge at the
  // shore would become a cliff wherever a later crater erases one side and not the other.
  const double dry = smoothstep(-600, 0, before_m - level_m);
  for (float& layer : layers.m) layer *= static_cast<float>(dry);
  layers.m[0] += static_cast<float>(after_m - layers.sum());
}

}  // namespace selenograph::dem::sample
