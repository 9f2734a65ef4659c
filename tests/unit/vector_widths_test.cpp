// The sensor's numbers, and detail's heights, are the same bits at every width of vectors.
#include "dem/base/vector_targets.h"
// Highway's headers come after it: which sets of vectors they know depends on it.
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

#include "dem/detail/detail.h"
#include "dem/grid/lattice.h"
#include "engine/sensor/detector.h"
#include "engine/sensor/optics.h"
#include "engine/sensor/random.h"

namespace selenograph::engine {
namespace {

// What `numbers` gives with the widest vectors it gives with all others, down to none.
template <typename Number>
void expect_same_at_every_width(const std::function<std::vector<Number>()>& numbers) {
  std::vector<Number> first;
  std::int64_t newer = 0;  // a newer target has a lower bit
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::DisableTargets(newer);
    newer |= target;
    const std::vector<Number> here = numbers();
    ASSERT_FALSE(here.empty());
    if (first.empty()) first = here;
    EXPECT_EQ(here, first) << hwy::TargetName(target);
  }
  hwy::DisableTargets(0);
}

TEST(VectorWidths, RandomNumbersAreTheSame) {
  expect_same_at_every_width<float>([] {
    std::vector<float> all;
    for (std::uint32_t pixel = 0; pixel < 100 * kDraw; pixel += kDraw) {
      RandomWords words;
      draw(3, 5, RandomSource::exposure, pixel, words);
      float mean[kDraw], out[kDraw];
      for (int i = 0; i < kDraw; ++i) mean[i] = 0.1F * static_cast<float>(i * i);
      normals(words.word[0], out);
      all.insert(all.end(), out, out + kDraw);
      poisson(words.word[1], mean, out);
      all.insert(all.end(), out, out + kDraw);
    }
    return all;
  });
}

TEST(VectorWidths, DetectedImagesAreTheSame) {
  SensorModel s;
  s.optics.f_number = 5.6;
  Detector& d = s.detector;
  d.pixel_pitch_um = 5.5, d.quantum_efficiency = 0.4, d.integration_time_s = 0.002, d.full_well_e = 13500;
  d.dark_current_e_s = 125, d.read_noise_e = 13, d.prnu = 0.01, d.dsnu_e = 4, d.gain_e_dn = 3.4, d.bit_depth = 12;
  d.dead_fraction = 0.01, d.hot_fraction = 0.01, d.hot_current_e_s = 1e6, d.smear_time_s = 1e-4;
  expect_same_at_every_width<std::uint16_t>([&] {
    std::vector<float> light(97 * 31);
    for (std::size_t i = 0; i < light.size(); ++i) light[i] = 0.01F * static_cast<float>(i % 1000);
    std::vector<std::uint16_t> image;
    detect(s, 0.65, light, 97, 31, image);
    return image;
  });
}

TEST(VectorWidths, BlurredImagesAreTheSame) {
  for (const PointSpread::Model model : {PointSpread::Model::gaussian, PointSpread::Model::airy}) {
    const SpreadKernel kernel({model, 0.8, {}, 0}, 4, 5.5, 0.65);
    expect_same_at_every_width<float>([&] {
      const int width = 61, height = 17, r = kernel.radius();
      std::vector<float> in(static_cast<std::size_t>((width + 2 * r) * (height + 2 * r))), out;
      for (std::size_t i = 0; i < in.size(); ++i) in[i] = static_cast<float>(i * i % 997) / 997;
      kernel.apply(in, width, height, out);
      return out;
    });
  }
}

TEST(VectorWidths, DetailIsTheSame) {
  dem::DetailPreset preset;
  preset.craters.smallest_m = 2, preset.craters.largest_m = 500;
  preset.relief.shortest_m = 2, preset.relief.longest_m = 500, preset.relief.deviation_m = 0.6;
  preset.albedo_variation = 1;
  const dem::Detail detail(preset);
  constexpr std::size_t kPostsAlong = 61;  // not whole vectors
  const dem::SquareGrid grid(-0.7, 1e-6, 2, 1e-6, kPostsAlong);
  expect_same_at_every_width<double>([&] {
    std::vector<double> heights(kPostsAlong * kPostsAlong);
    std::vector<float> in_crater(kPostsAlong * kPostsAlong);
    detail.add(grid.grid(), dem::kMaxLevel, 8, heights, {in_crater, {}, {}});
    heights.insert(heights.end(), in_crater.begin(), in_crater.end());
    std::vector<double> factors(kPostsAlong * kPostsAlong, 1.0);
    detail.add_crater_brightness(grid.grid(), dem::kMaxLevel, 8, factors);
    EXPECT_GT(*std::max_element(factors.begin(), factors.end()), 1.1);
    heights.insert(heights.end(), factors.begin(), factors.end());
    return heights;
  });
}

}  // namespace
}  // namespace selenograph::engine
