#include "engine/sensor/detector.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <numbers>
#include <numeric>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/base/quantile.h"
#include "dem/base/vector_targets.h"
#include "engine/radiometry/spectrum.h"
#include "engine/sensor/random.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/sensor/detector.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_DETECTOR_SHARED
#define SELENOGRAPH_ENGINE_DETECTOR_SHARED
namespace selenograph::engine {

// A detector's parameters in the units of the pixel loops.
struct PixelModel {
  float electrons_per_radiance;     // electrons per W m-2 sr-1
  float dark, hot;                  // mean dark electrons of a pixel; further ones of a hot pixel
  float prnu, dsnu;                 // standard deviations of the fixed pattern: of the response; of the offset, e-
  float read_noise, full_well;      // electrons
  float per_electron, offset, top;  // digital numbers: per electron; offset; largest
};

// Intermediate values of kDraw pixels on their way through the detector.
struct alignas(64) PixelLanes {
  float radiance[kDraw], smear[kDraw];                             // smear: electrons
  float response[kDraw], offset[kDraw], hot[kDraw], alive[kDraw];  // the detector's fixed pattern
  float mean[kDraw], counted[kDraw], fixed[kDraw], noise[kDraw];   // electrons; noise: standard normal
  std::uint16_t numbers[kDraw], saturated[kDraw];
};

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Computes the mean electrons and the fixed offsets of the pixels.
void ExposeLanes(const PixelModel& m, PixelLanes& p) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kDraw; ++i) {
    const float gain = 1 + m.prnu * p.response[i];
    const float signal = (p.radiance[i] * m.electrons_per_radiance + p.smear[i]) * (gain > 0 ? gain : 0) * p.alive[i];
    p.mean[i] = signal + m.dark + m.hot * p.hot[i];
    p.fixed[i] = m.dsnu * p.offset[i];
  }
}

// Converts electrons to digital numbers: full well, offset, read noise, gain.
void ReadLanes(const PixelModel& m, const float* electrons, PixelLanes& p) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kDraw; ++i) {
    const float held = electrons[i] < m.full_well ? electrons[i] : m.full_well;
    const float read = held + p.fixed[i] + m.read_noise * p.noise[i];
    const float dn = std::floor(read * m.per_electron + m.offset + 0.5F);
    const float low = dn > 0 ? dn : 0, clamped = low < m.top ? low : m.top;
    p.numbers[i] = static_cast<std::uint16_t>(static_cast<std::int32_t>(clamped));
    p.saturated[i] = electrons[i] >= m.full_well || dn >= m.top ? 1 : 0;
  }
}

// Decides from each pixel's random bits whether it is dead, hot or normal. `dead`, `dead_or_hot`: thresholds.
void FindDefects(const std::uint32_t* bits, std::uint32_t dead, std::uint32_t dead_or_hot, PixelLanes& p) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kDraw; ++i) {
    p.alive[i] = bits[i] < dead ? 0.F : 1.F;
    p.hot[i] = bits[i] >= dead && bits[i] < dead_or_hot ? 1.F : 0.F;
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(ExposeLanes);
HWY_EXPORT(ReadLanes);
HWY_EXPORT(FindDefects);

namespace {

// Returns 2^32 times a share of the pixels: random bits below it occur with that probability.
std::uint32_t threshold(double fraction) {
  return static_cast<std::uint32_t>(std::min(std::llround(fraction * 0x1p32), 0xffffffffLL));
}

// Returns the largest value except for the largest thousandth.
double maximum_without_outliers(std::vector<float> values) {
  if (values.empty()) return 0;
  return static_cast<double>(ranked(values, values.size() - 1 - values.size() / 1000));
}

// Takes pixels from radiance to digital numbers, kDraw at a time: electrons, fixed pattern, noise, read-out.
class PixelChain {
 public:
  PixelChain(const SensorModel& sensor, double wavelength_um, const std::vector<float>& radiance, int width, int height,
             bool line)
      : sensor_(sensor), radiance_(radiance), width_(static_cast<std::size_t>(width)) {
    const Detector& d = sensor.detector;
    const double per_radiance = electrons_per_radiance(sensor.optics, d, wavelength_um);
    model_ = {static_cast<float>(per_radiance),
              static_cast<float>(d.dark_current_e_s * d.integration_time_s),
              static_cast<float>(d.hot_current_e_s * d.integration_time_s),
              static_cast<float>(d.prnu),
              static_cast<float>(d.dsnu_e),
              static_cast<float>(d.read_noise_e),
              d.full_well_e > 0 ? static_cast<float>(d.full_well_e) : 1e30F,
              static_cast<float>(std::min(1 / d.gain_e_dn, double{std::numeric_limits<float>::max()})),
              static_cast<float>(d.offset_dn),
              static_cast<float>((1 << d.bit_depth) - 1)};
    smear_ = smear_e(d, per_radiance, radiance, width, height);
    dead_ = threshold(d.dead_fraction);
    dead_or_hot_ = threshold(d.dead_fraction + d.hot_fraction);
    has_pattern_ = d.prnu > 0 || d.dsnu_e > 0 || dead_or_hot_ > 0;
    has_noise_ = d.photon_noise || d.read_noise_e > 0;
    if (line && has_pattern_) draw_line();
  }

  // Reads out `count` pixels (at most kDraw) from `first` on. Returns how many are saturated.
  int run(std::size_t first, std::size_t count, std::uint16_t* image) const {
    PixelLanes p{};
    RandomWords words;
    expose(first, count, p, words);
    return read(first, count, collected(words, p), p, words, image);
  }

  // The same in two steps, between which electrons may move: what pixels collect, and what is read of it.
  void collect(std::size_t first, std::size_t count, float* electrons) const {
    PixelLanes p{};
    RandomWords words;
    expose(first, count, p, words);
    std::copy_n(collected(words, p), count, electrons + first);
  }
  // `electrons`: as many as whole packets of kDraw pixels have.
  int read(std::size_t first, std::size_t count, const float* electrons, std::uint16_t* image) const {
    PixelLanes p{};
    RandomWords words;
    expose(first, count, p, words);
    return read(first, count, electrons + first, p, words, image);
  }
  double max_smear_e() const { return maximum_without_outliers(smear_); }

 private:
  // Computes the mean electrons and the fixed offsets of pixels, and draws their random numbers.
  void expose(std::size_t first, std::size_t count, PixelLanes& p, RandomWords& words) const {
    std::copy_n(&radiance_[first], count, p.radiance);
    if (!smear_.empty())
      for (std::size_t i = 0; i < count; ++i) p.smear[i] = smear_[(first + i) % width_];
    std::fill_n(p.alive, kDraw, 1.F);
    const auto pixel = static_cast<std::uint32_t>(first);
    if (!line_.empty())
      repeat_line(first, p);
    else if (has_pattern_)
      draw_pattern(pixel, p);
    HWY_DYNAMIC_DISPATCH(ExposeLanes)(model_, p);
    if (has_noise_) draw(sensor_.seed, sensor_.frame, RandomSource::exposure, pixel, words);
  }

  // Returns the electrons that exposed pixels collect: their means, with photon noise if the detector has it.
  const float* collected(const RandomWords& words, PixelLanes& p) const {
    if (!sensor_.detector.photon_noise) return p.mean;
    poisson(words.word[0], p.mean, p.counted);
    return p.counted;
  }

  // Reads electrons out. `words`: of expose().
  int read(std::size_t first, std::size_t count, const float* electrons, PixelLanes& p, const RandomWords& words,
           std::uint16_t* image) const {
    if (sensor_.detector.read_noise_e > 0) normals(words.word[1], p.noise);
    HWY_DYNAMIC_DISPATCH(ReadLanes)(model_, electrons, p);
    std::copy_n(p.numbers, count, image + first);
    return std::accumulate(p.saturated, p.saturated + count, 0);
  }

  // Draws the fixed pattern of kDraw pixels of the detector.
  void draw_pattern(std::uint32_t pixel, PixelLanes& p) const {
    RandomWords words;
    draw(sensor_.seed, 0, RandomSource::fixed_pattern, pixel, words);
    if (sensor_.detector.prnu > 0) normals(words.word[0], p.response);
    if (sensor_.detector.dsnu_e > 0) normals(words.word[1], p.offset);
    if (dead_or_hot_ > 0) HWY_DYNAMIC_DISPATCH(FindDefects)(words.word[2], dead_, dead_or_hot_, p);
  }

  // Draws the fixed pattern of a line detector, whose pixels are those of the image's first row.
  void draw_line() {
    for (std::size_t first = 0; first < width_; first += kDraw) {
      PixelLanes& p = line_.emplace_back();
      std::fill_n(p.alive, kDraw, 1.F);
      draw_pattern(static_cast<std::uint32_t>(first), p);
    }
  }
  // Copies the line's pattern to kDraw pixels of the image, which may span two rows.
  void repeat_line(std::size_t first, PixelLanes& p) const {
    for (std::size_t i = 0; i < kDraw; ++i) {
      const std::size_t column = (first + i) % width_, k = column % kDraw;
      const PixelLanes& from = line_[column / kDraw];
      p.response[i] = from.response[k];
      p.offset[i] = from.offset[k];
      p.hot[i] = from.hot[k];
      p.alive[i] = from.alive[k];
    }
  }

  const SensorModel& sensor_;
  const std::vector<float>& radiance_;
  std::size_t width_;
  PixelModel model_;
  std::vector<float> smear_;
  std::vector<PixelLanes> line_;  // the pattern of a line detector, from column 0 on; else empty
  std::uint32_t dead_, dead_or_hot_;
  bool has_pattern_, has_noise_;
};

}  // namespace

double electrons_per_radiance(const Optics& optics, const Detector& d, double wavelength_um) {
  const double p = d.pixel_pitch_um * 1e-6, lambda = wavelength_um * 1e-6;
  return d.integration_time_s * std::numbers::pi * p * p / (4 * optics.f_number * optics.f_number) *
         d.quantum_efficiency * lambda / (kPlanck_j_s * kSpeedOfLight_m_s);  // eq. (8)
}

double filled_e(const Detector& d, double share) {
  const double counted_e = (share * ((1 << d.bit_depth) - 1) - d.offset_dn) * d.gain_e_dn;
  return d.full_well_e > 0 ? std::min(share * d.full_well_e, counted_e) : counted_e;
}

double radiant_flux_w(double pixel_pitch_um, double f_number, double efficiency, double radiance_w_m2_sr) {
  const double p = pixel_pitch_um * 1e-6;
  return std::numbers::pi / 4 * p * p / (f_number * f_number) * efficiency * radiance_w_m2_sr;  // eq. (9)
}

std::vector<float> smear_e(const Detector& d, double per_radiance, const std::vector<float>& radiance, int width,
                           int height) {
  if (!(d.smear_time_s > 0)) return {};
  std::vector<double> sums(static_cast<std::size_t>(width), 0);
  for (std::size_t y = 0; y < static_cast<std::size_t>(height); ++y)
    for (std::size_t x = 0; x < sums.size(); ++x) sums[x] += static_cast<double>(radiance[y * sums.size() + x]);
  std::vector<float> smear;
  smear.reserve(sums.size());
  for (const double sum : sums)
    smear.push_back(static_cast<float>(sum * per_radiance * d.smear_time_s / d.integration_time_s));
  return smear;
}

namespace {

// Returns the time after which a pixel holds a target, s: at most 1e30.
double time_to_hold_s(double headroom_e, double rate_e_s) {
  constexpr double kMax_s = 1e30, kMin_e_s = 1e-30;  // kMin_e_s avoids a division by zero
  return std::clamp(headroom_e / std::max(rate_e_s, kMin_e_s), -kMax_s, kMax_s);
}

}  // namespace

double time_to_fill_s(const SensorModel& sensor, double wavelength_um, double target_e,
                      const std::vector<float>& radiance, int width, int height) {
  Detector d = sensor.detector;
  d.integration_time_s = 1;
  const double per_second = electrons_per_radiance(sensor.optics, d, wavelength_um);
  const std::vector<float> smear = smear_e(d, per_second, radiance, width, height);
  const Metering& metering = sensor.exposure.metering;
  const ImageRegion region = metering.region.width > 0 ? metering.region : ImageRegion{0, 0, width, height};
  std::vector<float> times_s;
  times_s.reserve(static_cast<std::size_t>(region.width) * static_cast<std::size_t>(region.height));
  double sum_smear_e = 0, sum_rate_e_s = 0;
  for (int y = region.y; y < region.y + region.height; ++y)
    for (int x = region.x; x < region.x + region.width; ++x) {
      const auto column = static_cast<std::size_t>(x);
      const std::size_t pixel = static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + column;
      const double smeared_e = smear.empty() ? 0 : static_cast<double>(smear[column]),
                   rate_e_s = static_cast<double>(radiance[pixel]) * per_second + d.dark_current_e_s;
      sum_smear_e += smeared_e;
      sum_rate_e_s += rate_e_s;
      times_s.push_back(static_cast<float>(time_to_hold_s(target_e - smeared_e, rate_e_s)));
    }
  const auto pixels = static_cast<double>(times_s.size());
  if (metering.statistic == Metering::Statistic::mean)
    return time_to_hold_s(target_e - sum_smear_e / pixels, sum_rate_e_s / pixels);
  constexpr double kRounding = 1e-6;  // 1 - 0.999 is below 0.001
  const auto brighter = static_cast<std::size_t>(pixels * (1 - metering.percentile / 100) + kRounding);
  return static_cast<double>(ranked(times_s, std::min(brighter, times_s.size() - 1)));
}

double bloom(double full_well_e, int width, int height, std::span<float> electrons) {
  const auto columns = static_cast<std::size_t>(width), rows = static_cast<std::size_t>(height);
  std::vector<double> excess_e(rows);
  double lost_e = 0;
  for (std::size_t x = 0; x < columns; ++x) {
    bool spills = false;
    for (std::size_t y = 0; y < rows; ++y) {
      float& held = electrons[y * columns + x];
      excess_e[y] = std::max(static_cast<double>(held) - full_well_e, 0.);
      if (excess_e[y] > 0) held = static_cast<float>(full_well_e);
      spills |= excess_e[y] > 0;
    }
    if (!spills) continue;
    double moving_e = 0;
    const auto pass = [&](std::size_t y) {
      moving_e += excess_e[y] / 2;
      float& held = electrons[y * columns + x];
      const double taken_e = std::min(moving_e, full_well_e - static_cast<double>(held));
      held = static_cast<float>(static_cast<double>(held) + taken_e);
      moving_e -= taken_e;
    };
    for (std::size_t y = 0; y < rows; ++y) pass(y);
    lost_e += std::exchange(moving_e, 0);
    for (std::size_t y = rows; y-- > 0;) pass(y);
    lost_e += moving_e;
  }
  return lost_e;
}

ReadOut detect(const SensorModel& sensor, double wavelength_um, const std::vector<float>& radiance, int width,
               int height, std::vector<std::uint16_t>& image, const StopToken& stop, bool line) {
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  image.resize(pixels);
  const PixelChain pixel_chain(sensor, wavelength_um, radiance, width, height, line);
  constexpr std::size_t kLanes = kDraw;
  const std::size_t packets = (pixels + kLanes - 1) / kLanes;
  std::vector<float> electrons;  // after blooming; empty: no pixel blooms
  if (sensor.detector.blooming) {
    electrons.resize(packets * kLanes);
    in_parallel_pieces(packets, 64, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t k = first; k < past_last; ++k)
        pixel_chain.collect(k * kLanes, std::min(kLanes, pixels - k * kLanes), electrons.data());
    });
    bloom(sensor.detector.full_well_e, width, height, std::span(electrons).first(pixels));
    stop.check();
  }
  std::atomic<std::size_t> saturated{0};
  std::mutex brightest_mutex;
  float brightest_w_m2_sr = 0;
  in_parallel_pieces(packets, 64, [&](std::size_t first, std::size_t past_last) {
    const float piece_brightest =
        *std::max_element(&radiance[first * kLanes], &radiance[0] + std::min(past_last * kLanes, pixels));
    std::size_t piece_saturated = 0;
    for (std::size_t k = first; k < past_last; ++k) {
      if (k % 64 == 0) stop.check();
      const std::size_t count = std::min(kLanes, pixels - k * kLanes);
      piece_saturated += static_cast<std::size_t>(
          electrons.empty() ? pixel_chain.run(k * kLanes, count, image.data())
                            : pixel_chain.read(k * kLanes, count, electrons.data(), image.data()));
    }
    saturated += piece_saturated;
    const std::scoped_lock lock(brightest_mutex);
    brightest_w_m2_sr = std::max(brightest_w_m2_sr, piece_brightest);
  });
  const double share = pixels == 0 ? 0 : static_cast<double>(saturated) / static_cast<double>(pixels);
  const double brightest_e =
      static_cast<double>(brightest_w_m2_sr) * electrons_per_radiance(sensor.optics, sensor.detector, wavelength_um);
  return {share, brightest_e, pixel_chain.max_smear_e()};
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
