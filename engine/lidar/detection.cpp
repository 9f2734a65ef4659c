#include "engine/lidar/detection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "engine/sensor/random.h"

namespace selenograph::engine {
namespace {

constexpr double kHalfLight_m_ns = kLight_m_ns / 2;
constexpr double kPlanckLight_j_um = 1.98644586e-19;  // h c
constexpr double kFullWidth = 2.3548200450309493;     // of a Gaussian at half maximum, in deviations
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr float kNoSignal = std::numeric_limits<float>::quiet_NaN();

// What the words of a beam are for.
enum class Purpose : std::uint64_t { false_alarms = 0, velocity = 1, strongest_alarm = 2, first_return = 16 };

// (scan, purpose) is the frame of the numbers: scans are below 2^53.
RandomBits bits_of(std::uint64_t seed, std::uint64_t scan, std::uint64_t purpose, std::uint32_t beam) {
  return draw_one(seed, scan << 5 | purpose, RandomSource::lidar, beam);
}

double unit(std::uint32_t bits) { return (static_cast<double>(bits) + 0.5) * 0x1p-32; }

// What a beam has detected so far.
struct Detected {
  LidarDetection out{kNone, kNone, kNone, kNoSignal, kNoSignal, kNoSignal};
  std::size_t count = 0;

  void add(double range_m, double signal) {
    const auto s = static_cast<float>(signal);
    ++count;
    if (!(range_m >= out.first_m)) out.first_m = range_m, out.first = s;
    if (!(range_m <= out.last_m)) out.last_m = range_m, out.last = s;
  }
  // Detections as strong as each other, one of which has this range. All of the strongest have the same chance.
  struct Alike {
    double strength, number;
    bool false_alarms;
  };
  void take_strongest(double range_m, double signal, const Alike& alike, std::uint32_t bits) {
    if (alike.strength < most_) return;
    number_of_most_ = alike.strength > most_ ? alike.number : number_of_most_ + alike.number;
    most_ = alike.strength;
    if (unit(bits) * number_of_most_ >= alike.number) return;
    out.strongest_m = range_m, out.strongest = static_cast<float>(signal), out.false_alarm = alike.false_alarms;
  }

 private:
  double most_ = -std::numeric_limits<double>::infinity(), number_of_most_ = 0;
};

double gain_of(const LidarInstrument& instrument) {
  const LidarReceiver& r = instrument.receiver;
  if (r.signal == LidarSignal::snr) return r.snr * r.range_m * r.range_m * std::numbers::pi / r.reflectance;
  const double photons = r.energy_j * instrument.wavelength_um / kPlanckLight_j_um,
               area_m2 = std::numbers::pi / 4 * r.aperture_m * r.aperture_m;
  return photons * area_m2 * r.efficiency;
}

}  // namespace

double poisson_reaches(double mean, double threshold) {
  if (!(threshold > 0)) return 1;
  // By what is below the threshold, or, where that is nearly all, by what reaches it.
  const double first = std::ceil(threshold);
  const auto chance = [&](double k) { return std::exp(k * std::log(mean) - mean - std::lgamma(k + 1)); };
  if (!(mean > 0)) return 0;
  double sum = 0;
  if (mean < first) {
    double p = chance(first);
    for (double k = first; p > 1e-20 * (sum + 1e-300) && k < first + 1e5; p *= mean / ++k) sum += p;
    return std::min(1.0, sum);
  }
  double p = chance(first - 1);
  for (double k = first - 1; k >= 0 && p > 1e-20 * (sum + 1e-300); p *= k / mean, --k) sum += p;
  return std::clamp(1 - sum, 0.0, 1.0);
}

double normal_exceeds(double x) { return std::erfc(x / std::numbers::sqrt2) / 2; }

LidarReceiverModel::LidarReceiverModel(const LidarInstrument& instrument)
    : instrument_(instrument), gain_(gain_of(instrument)), cell_m_(kHalfLight_m_ns * instrument.pulse_length_ns) {
  const double cells = (instrument.gate.far_m - instrument.gate.near_m) / cell_m_;
  const double chance = instrument.receiver.signal == LidarSignal::snr
                            ? normal_exceeds(instrument.threshold)
                            : poisson_reaches(dark_counts(cell_m_), instrument.threshold);
  false_alarms_ = cells * chance;
}

// Within a full width.
double LidarReceiverModel::dark_counts(double width_m) const {
  return instrument_.dark_count_hz * 1e-9 * width_m / kHalfLight_m_ns;
}

LidarDetection LidarReceiverModel::detect(std::span<const EchoReturn> returns, std::uint64_t seed, std::uint64_t scan,
                                          std::uint32_t beam) const {
  Detected all;
  const bool counting = instrument_.receiver.signal == LidarSignal::photon_counting;
  const double timing_m = kHalfLight_m_ns * instrument_.timing_noise_ns;
  for (std::size_t k = 0; k < returns.size(); ++k) {
    const EchoReturn& one = returns[k];
    if (!in_gate(one.range_m)) continue;
    const RandomBits bits =
        bits_of(seed, scan, static_cast<std::uint64_t>(Purpose::first_return) + k % Echo::kMost, beam);
    const double full_width_m = std::max(cell_m_, kFullWidth * one.width_m);
    const double dark = counting ? dark_counts(full_width_m) : 0;
    const double found = counting ? static_cast<double>(poisson_one(bits[0], static_cast<float>(one.signal + dark)))
                                  : one.signal + static_cast<double>(normal_one(bits[0]));
    if (!(found >= instrument_.threshold)) continue;
    const double deviation_m = counting ? one.width_m / std::sqrt(found) : one.width_m / std::max(1.0, one.signal);
    const double range_m = one.range_m + deviation_m * static_cast<double>(normal_one(bits[1])) +
                           timing_m * static_cast<double>(normal_one(bits[2])),
                 signal = counting ? std::max(0.0, found - dark) : found;
    all.add(range_m, signal);
    all.take_strongest(range_m, signal, {.strength = found, .number = 1, .false_alarms = false}, bits[3]);
  }
  if (false_alarms_ > 1e-12) {
    const RandomBits bits = bits_of(seed, scan, static_cast<std::uint64_t>(Purpose::false_alarms), beam);
    const auto alarms = static_cast<double>(poisson_one(bits[0], static_cast<float>(false_alarms_)));
    const double near_m = instrument_.gate.near_m, length_m = instrument_.gate.far_m - near_m;
    // Hardly any has more than it takes.
    const double strength = counting ? std::ceil(instrument_.threshold) : instrument_.threshold,
                 signal = counting ? std::max(0.0, strength - dark_counts(cell_m_)) : strength;
    if (alarms > 0) {
      // Of n uniform ranges the nearest, of those beyond it the farthest, and of all any one.
      const double nearest = 1 - std::pow(unit(bits[1]), 1 / alarms);
      double any = nearest;
      all.add(near_m + length_m * nearest, signal);
      if (alarms > 1) {
        const double farthest = nearest + (1 - nearest) * std::pow(unit(bits[2]), 1 / (alarms - 1));
        all.add(near_m + length_m * farthest, signal);
        all.count += static_cast<std::size_t>(std::min(alarms - 2, 255.0));
        const RandomBits of_any = bits_of(seed, scan, static_cast<std::uint64_t>(Purpose::strongest_alarm), beam);
        const double which = std::floor(unit(of_any[0]) * alarms);
        any = which == 0 ? nearest : which == 1 ? farthest : std::lerp(nearest, farthest, unit(of_any[1]));
      }
      all.take_strongest(near_m + length_m * any, signal,
                         {.strength = strength, .number = alarms, .false_alarms = true}, bits[3]);
    }
  }
  LidarDetection& out = all.out;
  out.count = static_cast<std::uint8_t>(std::min<std::size_t>(all.count, 255));
  if (instrument_.velocity_noise_m_s > 0 && out.count > 0)
    out.velocity_noise_m_s = static_cast<float>(instrument_.velocity_noise_m_s) *
                             normal_one(bits_of(seed, scan, static_cast<std::uint64_t>(Purpose::velocity), beam)[0]);
  return out;
}

}  // namespace selenograph::engine
