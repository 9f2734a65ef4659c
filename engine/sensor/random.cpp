#include "engine/sensor/random.h"

#include <Random123/philox.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/sensor/random.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Returns the logarithm of a normal number above 0, to 2 units in the last place. Written out so that the compiler
// vectorises it, with the same bits on every machine.
inline float logarithm(float x) {
  const auto bits = std::bit_cast<std::uint32_t>(x);
  const float mantissa = std::bit_cast<float>((bits & 0x007fffffU) | 0x3f800000U);  // 1 to 2
  const bool upper = mantissa > 1.41421356F;
  const float m = upper ? mantissa * 0.5F : mantissa;
  const float exponent = static_cast<float>(static_cast<std::int32_t>(bits >> 23) - 127) + (upper ? 1.F : 0.F);
  const float s = (m - 1) / (m + 1), s2 = s * s;
  const float series = s * (2 + s2 * (2.F / 3 + s2 * (2.F / 5 + s2 * (2.F / 7 + s2 * (2.F / 9)))));
  return exponent * 0.693147181F + series;
}

// Returns the normal deviate at the probability (bits + 1/2) / 2^32: Wichura's algorithm AS 241, PPND7 (1988).
inline float normal_of(std::uint32_t bits) {
  const bool high = bits >> 31 != 0;
  const std::uint32_t from_end = high ? ~bits : bits;  // below 2^31: vectors convert signed integers only
  const float p = (static_cast<float>(static_cast<std::int32_t>(from_end)) + 0.5F) * 0x1p-32F;  // above 0, at most 1/2
  const float q = 0.5F - p;
  const float r = 0.180625F - q * q;
  const float middle = q * (((59.109374720F * r + 159.29113202F) * r + 50.434271938F) * r + 3.3871327179F) /
                       (((67.187563600F * r + 78.757757664F) * r + 17.895169469F) * r + 1);
  const float t = std::sqrt(-logarithm(p)) - 1.6F;
  const float tail = (((0.17023821103F * t + 1.3067284816F) * t + 2.7568153900F) * t + 1.4234372777F) /
                     ((0.12021132975F * t + 0.73700164250F) * t + 1);
  const float x = q <= 0.425F ? middle : tail;
  return high ? x : -x;
}

// Returns a Poisson deviate for a mean of kExactPoisson or more.
inline float poisson_of_large_mean(std::uint32_t bits, float m) {
  const float w = normal_of(bits), w2 = w * w, root = std::sqrt(m);
  const float x = m + root * w + (1.F / 3 + w2 / 6) - w * (1.F / 36 + w2 / 72) / root +
                  (-8.F / 405 + w2 * (7.F / 810 + w2 / 270)) / m;
  const float count = std::floor(x);
  return count > 0 ? count : 0;
}

// Sets the deviates of all lanes as for large means. Returns 1 if a lane's mean is small: the caller replaces those.
int PoissonOfLargeMeans(const std::uint32_t* bits, const float* mean, float* out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kDraw; ++i)
    out[i] = poisson_of_large_mean(bits[i], mean[i] > kExactPoisson ? mean[i] : kExactPoisson);
  int any_small = 0;
  for (int i = 0; i < kDraw; ++i) any_small |= mean[i] < kExactPoisson ? 1 : 0;
  return any_small;
}

// Returns the four random words of a pixel: Philox's function of the counter (pixel, frame, source) and the key, seed.
HWY_INLINE philox4x32_ctr_t words_of(std::uint64_t seed, std::uint64_t frame, RandomSource source,
                                     std::uint32_t pixel) {
  const philox4x32_ctr_t counter{{pixel, static_cast<std::uint32_t>(frame), static_cast<std::uint32_t>(frame >> 32),
                                  static_cast<std::uint32_t>(source)}};
  const philox4x32_key_t key{{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)}};
  return philox4x32(counter, key);
}

void Draw(std::uint64_t seed, std::uint64_t frame, RandomSource source, std::uint32_t pixel, RandomWords& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::uint32_t i = 0; i < kDraw; ++i) {
    const philox4x32_ctr_t words = words_of(seed, frame, source, pixel + i);
    for (int k = 0; k < 4; ++k) out.word[k][i] = words.v[k];
  }
}

void Normals(const std::uint32_t bits[kDraw], float out[kDraw]) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kDraw; ++i) out[i] = normal_of(bits[i]);
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(PoissonOfLargeMeans);
HWY_EXPORT(Draw);
HWY_EXPORT(Normals);

namespace {

// Returns a Poisson deviate for a small mean: adds up probabilities until they exceed u.
float poisson_of_small_mean(std::uint32_t bits, float mean) {
  const double u = (static_cast<double>(bits) + 0.5) * 0x1p-32;
  double probability = std::exp(-static_cast<double>(mean)), sum = probability;
  int k = 0;
  while (sum < u && k < 200) {
    probability *= static_cast<double>(mean) / ++k;
    sum += probability;
  }
  return static_cast<float>(k);
}

}  // namespace

void draw(std::uint64_t seed, std::uint64_t frame, RandomSource source, std::uint32_t pixel, RandomWords& out) {
  HWY_DYNAMIC_DISPATCH(Draw)(seed, frame, source, pixel, out);
}

void normals(const std::uint32_t bits[kDraw], float out[kDraw]) { HWY_DYNAMIC_DISPATCH(Normals)(bits, out); }

void poisson(const std::uint32_t bits[kDraw], const float mean[kDraw], float out[kDraw]) {
  if (!HWY_DYNAMIC_DISPATCH(PoissonOfLargeMeans)(bits, mean, out)) return;
  for (int i = 0; i < kDraw; ++i)
    if (mean[i] < kExactPoisson) out[i] = mean[i] > 0 ? poisson_of_small_mean(bits[i], mean[i]) : 0;
}

RandomBits draw_one(std::uint64_t seed, std::uint64_t frame, RandomSource source, std::uint32_t pixel) {
  const philox4x32_ctr_t words = HWY_NAMESPACE::words_of(seed, frame, source, pixel);
  return {words.v[0], words.v[1], words.v[2], words.v[3]};
}

float normal_one(std::uint32_t bits) { return HWY_NAMESPACE::normal_of(bits); }

float poisson_one(std::uint32_t bits, float mean) {
  if (!(mean > 0)) return 0;
  return mean < kExactPoisson ? poisson_of_small_mean(bits, mean) : HWY_NAMESPACE::poisson_of_large_mean(bits, mean);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
