// Counter-based random numbers and hashes: known answers, distributions, independence.
#include "engine/sensor/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include "dem/base/hash.h"
#include "dem/detail/size_cells.h"

namespace selenograph::engine {
namespace {

double distribution(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

// Random123's known-answer file, philox4x32-10: the key is the seed, low word first.
TEST(Random, KnownAnswers) {
  RandomWords words;
  draw(0, 0, RandomSource::exposure, 0, words);
  EXPECT_EQ(words.word[0][0], 0x6627e8d5U);
  EXPECT_EQ(words.word[1][0], 0xe169c58dU);
  EXPECT_EQ(words.word[2][0], 0xbc57ac4cU);
  EXPECT_EQ(words.word[3][0], 0x9b00dbd8U);
}

TEST(Random, IsAFunctionOfSeedFramePixelAndSource) {
  RandomWords here, there;
  draw(5, 7, RandomSource::exposure, 1000, here);
  draw(5, 7, RandomSource::exposure, 1003, there);
  for (int k = 0; k < 4; ++k) EXPECT_EQ(here.word[k][3], there.word[k][0]);
  const auto differs = [&](std::uint64_t seed, std::uint64_t frame, RandomSource source) {
    draw(seed, frame, source, 1000, there);
    int same = 0;
    for (int i = 0; i < kDraw; ++i) same += here.word[0][i] == there.word[0][i];
    return same == 0;
  };
  EXPECT_TRUE(differs(6, 7, RandomSource::exposure));
  EXPECT_TRUE(differs(5 + (std::uint64_t{1} << 32), 7, RandomSource::exposure));
  EXPECT_TRUE(differs(5, 8, RandomSource::exposure));
  EXPECT_TRUE(differs(5, 7 + (std::uint64_t{1} << 32), RandomSource::exposure));
  EXPECT_TRUE(differs(5, 7, RandomSource::fixed_pattern));
}

// Against the distribution function itself, in both tails down to the last bit.
TEST(Random, NormalsInvertTheirDistribution) {
  double worst = 0;
  const auto check = [&](std::uint32_t first, std::uint32_t step) {
    std::uint32_t bits[kDraw];
    float x[kDraw];
    for (std::uint32_t i = 0; i < kDraw; ++i) bits[i] = first + i * step;
    normals(bits, x);
    for (int i = 0; i < kDraw; ++i) {
      const double u = (static_cast<double>(bits[i]) + 0.5) * 0x1p-32, tail = std::min(u, 1 - u);
      const double p = distribution(-std::abs(static_cast<double>(x[i])));
      worst = std::max(worst, std::abs(p - tail) / tail);
      EXPECT_EQ(std::signbit(x[i]), u < 0.5) << bits[i];
    }
  };
  for (std::uint32_t k = 0; k < 1024; ++k) check(k << 22, 65537);
  for (const std::uint32_t step : {1U, 1000U, 1000000U}) check(0, step), check(0xffffffffU - 63 * step, step);
  EXPECT_LT(worst, 1e-5);
}

// The distribution that `poisson` has, from where its steps are: exactly the right one but for 5e-5.
TEST(Random, PoissonInvertsItsDistribution) {
  for (const float mean : {0.01F, 0.7F, 3.F, 9.99F, 10.F, 12.5F, 30.F, 300.F, 5000.F, 80000.F}) {
    // The smallest u that gives more than k, by bisection.
    const auto value = [&](std::uint32_t u) {
      std::uint32_t bits[kDraw];
      float means[kDraw], out[kDraw];
      for (int i = 0; i < kDraw; ++i) bits[i] = u, means[i] = mean;
      poisson(bits, means, out);
      return static_cast<double>(out[0]);
    };
    const double m = static_cast<double>(mean), spread = std::sqrt(m);
    for (double k = std::max(0.0, std::floor(m - 4 * spread)); k <= m + 4 * spread + 2;
         k += std::max(1.0, std::floor(spread / 5))) {
      std::uint32_t low = 0, high = 0xffffffffU;
      if (value(low) > k || value(high) <= k) continue;
      while (high - low > 1) (value(low + (high - low) / 2) > k ? high : low) = low + (high - low) / 2;
      // P(X <= k): the regularised upper incomplete gamma function, summed outwards from the mean.
      double sum = 0;
      for (double j = 0; j <= k; ++j) sum += std::exp(j * std::log(m) - m - std::lgamma(j + 1));
      EXPECT_NEAR(high * 0x1p-32, sum, 5e-5 + 2e-7 * spread) << mean << ' ' << k;
    }
  }
}

TEST(Random, PoissonOfZeroIsZero) {
  std::uint32_t bits[kDraw];
  float means[kDraw], out[kDraw];
  for (int i = 0; i < kDraw; ++i) bits[i] = 0xffffffffU, means[i] = i % 2 ? 0.F : -3.F;
  poisson(bits, means, out);
  for (const float x : out) EXPECT_EQ(x, 0);
}

// Means, variances and correlations of a million numbers, each within five standard errors.
TEST(Random, MomentsAndIndependence) {
  constexpr int kBlocks = 16384, kN = kBlocks * kDraw;
  double sum = 0, squares = 0, neighbours = 0, frames = 0, words = 0;
  float before = 0;
  for (int b = 0; b < kBlocks; ++b) {
    RandomWords now, next;
    float x[kDraw], y[kDraw], z[kDraw];
    draw(11, 3, RandomSource::exposure, static_cast<std::uint32_t>(b * kDraw), now);
    draw(11, 4, RandomSource::exposure, static_cast<std::uint32_t>(b * kDraw), next);
    normals(now.word[0], x), normals(next.word[0], y), normals(now.word[1], z);
    for (int i = 0; i < kDraw; ++i) {
      const double a = static_cast<double>(x[i]);
      sum += a, squares += a * a, neighbours += a * static_cast<double>(before);
      frames += a * static_cast<double>(y[i]), words += a * static_cast<double>(z[i]);
      before = x[i];
    }
  }
  const double error = 5 / std::sqrt(static_cast<double>(kN));
  EXPECT_NEAR(sum / kN, 0, error);
  EXPECT_NEAR(squares / kN, 1, error * std::sqrt(2.0));
  EXPECT_NEAR(neighbours / kN, 0, error);
  EXPECT_NEAR(frames / kN, 0, error);
  EXPECT_NEAR(words / kN, 0, error);
}

// Computed by libxxhash 0.8.1, which is compiled apart from its callers. Each length takes another of its branches.
TEST(Hashes, KnownAnswers) {
  std::string bytes;
  for (int i = 0; i < 300; ++i) bytes += static_cast<char>(i);
  const auto hash = [&](std::size_t count) { return dem::hash_of(bytes.data(), count, 7); };
  EXPECT_EQ(hash(0), 0x913ae0873e9b7eb8U);
  EXPECT_EQ(hash(3), 0x3868dcb498f6507cU);
  EXPECT_EQ(hash(8), 0xdb86d781f5b8bd4aU);
  EXPECT_EQ(hash(16), 0xee0b9003ece2cff1U);
  EXPECT_EQ(hash(24), 0x50e080f42c3fd60dU);
  EXPECT_EQ(hash(100), 0xf99b79905a88dc51U);
  EXPECT_EQ(hash(200), 0x68decbfb306ebdf2U);
  EXPECT_EQ(hash(300), 0xb863d8c6eef5bca4U);
  EXPECT_EQ(dem::xxh64_of(bytes.data(), 300, 7), 0x8a170415d75142c7U);
  dem::StreamedHash streamed;
  streamed.add_text(bytes);
  EXPECT_EQ(streamed.digest(), dem::hash_of(bytes.data(), bytes.size()));
}

// Both draws of normal() are inlined, so that the compiler sees the key change between two hashes of it.
TEST(Hashes, SeesWhatIsStoredBetweenTwoHashes) {
  dem::Draws pairs(1, 2, 3, 4), singles(1, 2, 3, 4);
  for (int i = 0; i < 100; ++i) {
    const double a = singles.uniform(), b = singles.uniform();
    EXPECT_NE(a, b);
    EXPECT_DOUBLE_EQ(pairs.normal(), std::sqrt(-2 * std::log(a)) * std::cos(2 * std::numbers::pi * b));
  }
}

}  // namespace
}  // namespace selenograph::engine
