#include "engine/lidar/detection.h"

#include <algorithm>
#include <array>
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

// Purpose of a beam's random words. A return's words have first_return + its number.
enum class Purpose : std::uint64_t { false_alarms = 0, velocity = 1, strongest_alarm = 2, first_return = 16 };

std::uint64_t word_of(Purpose purpose) { return static_cast<std::uint64_t>(purpose); }

// Returns four random words. (word block, scan, purpose) take the generator's frame number: 6, 53 and 5 bits.
RandomBits bits_of(std::uint64_t seed, std::uint64_t scan, std::uint64_t purpose, std::uint32_t beam,
                   std::uint64_t word_block = 0) {
  return draw_one(seed, word_block << 58 | scan << 5 | purpose, RandomSource::lidar, beam);
}

// Returns the uniform deviate of 32 random bits: above 0 and below 1.
double unit(std::uint32_t bits) { return (static_cast<double>(bits) + 0.5) * 0x1p-32; }

// Accumulates a beam's detections: their count, the first, the last and the strongest.
struct Detections {
  LidarDetection out{kNone, kNone, kNone, kNoSignal, kNoSignal, kNoSignal};
  std::size_t count = 0;

  void add(double range_m, double signal) {
    const auto s = static_cast<float>(signal);
    ++count;
    if (!(range_m >= out.first_m)) {
      out.first_m = range_m;
      out.first = s;
    }
    if (!(range_m <= out.last_m)) {
      out.last_m = range_m;
      out.last = s;
    }
  }
  // A group of equally strong detections.
  struct Tie {
    double strength, number;
    bool false_alarms;
  };
  // Offers a group and the range of one of its detections, drawn by the caller. Reservoir sampling: the group replaces
  // an equally strong one with the chance that gives each detection of both groups the same probability.
  void offer_strongest(double range_m, double signal, const Tie& tie, std::uint32_t bits) {
    if (tie.strength < highest_) return;
    number_of_highest_ = tie.strength > highest_ ? tie.number : number_of_highest_ + tie.number;
    highest_ = tie.strength;
    if (unit(bits) * number_of_highest_ >= tie.number) return;
    out.strongest_m = range_m;
    out.strongest = static_cast<float>(signal);
    out.false_alarm = tie.false_alarms;
  }

 private:
  double highest_ = -std::numeric_limits<double>::infinity(), number_of_highest_ = 0;
};

// False alarms of a beam. Each cell of the gate has one with the same chance, so the number of cells without an alarm
// before the next one has a geometric distribution. Positions are in cells from the near end of the gate.
class AlarmCells {
 public:
  AlarmCells(double cells, double chance) : cells_(cells), chance_(chance), log_of_none_(std::log1p(-chance)) {}

  struct Alarms {
    double number = 0;                             // above kMaxDrawn: its expected value
    double nearest = 0, farthest = 0, random = 0;  // random: one of all alarms, with equal chances
    std::uint32_t tie = 0;                         // random bits that choose among equally strong detections
  };
  Alarms draw(std::uint64_t seed, std::uint64_t scan, std::uint32_t beam) const {
    std::array<double, kMaxDrawn> positions;
    std::size_t drawn = 0;
    RandomBits bits{};
    for (double cell = -1; drawn < kMaxDrawn; ++drawn) {
      if (drawn % 4 == 0) bits = bits_of(seed, scan, word_of(Purpose::false_alarms), beam, drawn / 4);
      const std::uint32_t word = bits[drawn % 4];
      cell += 1 + cells_without(word);
      // Many words lead to the same cell. Multiplying by an odd number spreads them uniformly within the cell.
      positions[drawn] = cell + unit(word * 0x9E3779B1U);
      if (!(positions[drawn] < cells_)) break;
    }
    if (drawn == 0) return {};
    const RandomBits words = bits_of(seed, scan, word_of(Purpose::strongest_alarm), beam);
    const auto number = static_cast<double>(drawn);
    const double last = positions[drawn - 1], choice = unit(words[0]);
    if (drawn < kMaxDrawn)
      return {number, positions[0], last, positions[static_cast<std::size_t>(choice * number)], words[3]};
    // Too many to draw each: draw the farthest from the gate's far end, and expect the number in between.
    const double farthest = std::max(last, cells_ - cells_without(words[1]) - unit(words[2]));
    return {number + chance_ * (cells_ - last), positions[0], farthest, choice * cells_, words[3]};
  }

 private:
  static constexpr std::size_t kMaxDrawn = 256;
  // Returns a geometric deviate: cells without an alarm before the next alarm.
  double cells_without(std::uint32_t word) const { return std::floor(std::log(unit(word)) / log_of_none_); }

  double cells_, chance_, log_of_none_;  // log_of_none_: log(1 - chance)
};

// Returns the factor from an echo's sum of weight * mu0 f_r / range^2 to its signal: photons counted or, for `snr`,
// units of the noise, which follow from the reference target, a Lambertian surface at r.range_m.
double gain_of(const LidarInstrument& instrument) {
  const LidarReceiver& r = instrument.receiver;
  if (r.signal == LidarSignal::snr) return r.snr * r.range_m * r.range_m * std::numbers::pi / r.reflectance;
  const double photons = r.energy_j * instrument.wavelength_um / kPlanckLight_j_um,
               area_m2 = std::numbers::pi / 4 * r.aperture_m * r.aperture_m;
  return photons * area_m2 * r.efficiency;
}

}  // namespace

double poisson_tail(double mean, double threshold) {
  if (!(threshold > 0)) return 1;
  // Sum the smaller tail: the counts below the threshold or, for a mean below it, those that reach it.
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

double normal_tail(double x) { return std::erfc(x / std::numbers::sqrt2) / 2; }

LidarReceiverModel::LidarReceiverModel(const LidarInstrument& instrument)
    : instrument_(instrument),
      gain_(gain_of(instrument)),
      cell_m_(kHalfLight_m_ns * instrument.pulse_length_ns),
      cells_((instrument.gate.far_m - instrument.gate.near_m) / cell_m_),
      alarm_chance_(instrument.receiver.signal == LidarSignal::snr
                        ? normal_tail(instrument.threshold)
                        : poisson_tail(dark_counts(cell_m_), instrument.threshold)) {}

// Returns the mean number of dark counts while light travels `width_m` and back.
double LidarReceiverModel::dark_counts(double width_m) const {
  return instrument_.dark_count_hz * 1e-9 * width_m / kHalfLight_m_ns;
}

LidarDetection LidarReceiverModel::detect(std::span<const EchoReturn> returns, std::uint64_t seed, std::uint64_t scan,
                                          std::uint32_t beam) const {
  Detections detections;
  const bool counting = instrument_.receiver.signal == LidarSignal::photon_counting;
  const double timing_m = kHalfLight_m_ns * instrument_.timing_noise_ns;
  for (std::size_t k = 0; k < returns.size(); ++k) {
    const EchoReturn& echo = returns[k];
    if (!in_gate(echo.range_m)) continue;
    const RandomBits bits = bits_of(seed, scan, word_of(Purpose::first_return) + k % Echo::kMaxReturns, beam);
    const double full_width_m = std::max(cell_m_, kFullWidth * echo.width_m);
    const double dark = counting ? dark_counts(full_width_m) : 0;
    const double measured = counting ? static_cast<double>(poisson_one(bits[0], static_cast<float>(echo.signal + dark)))
                                     : echo.signal + static_cast<double>(normal_one(bits[0]));
    if (!(measured >= instrument_.threshold)) continue;
    const double deviation_m =
        counting ? echo.width_m / std::sqrt(measured) : echo.width_m / std::max(1.0, echo.signal);
    const double noise_m =
        deviation_m * static_cast<double>(normal_one(bits[1])) + timing_m * static_cast<double>(normal_one(bits[2]));
    const double range_m = std::max(0.0, echo.range_m + noise_m), signal = measured - dark;
    detections.add(range_m, signal);
    detections.offer_strongest(range_m, signal, {.strength = measured, .number = 1, .false_alarms = false}, bits[3]);
  }
  constexpr double kMinAlarms = 1e-12;
  if (expected_false_alarms() > kMinAlarms) {
    const AlarmCells::Alarms alarms = AlarmCells(cells_, alarm_chance_).draw(seed, scan, beam);
    const auto range_m = [&](double cell) { return instrument_.gate.near_m + cell_m_ * cell; };
    // Give alarms exactly the threshold's strength: hardly any exceeds it.
    const double strength = counting ? std::ceil(instrument_.threshold) : instrument_.threshold,
                 signal = counting ? strength - dark_counts(cell_m_) : strength;
    if (alarms.number > 0) detections.add(range_m(alarms.nearest), signal);
    if (alarms.number > 1) detections.add(range_m(alarms.farthest), signal);
    if (alarms.number > 2) detections.count += static_cast<std::size_t>(std::min(alarms.number - 2, 255.0));
    if (alarms.number > 0)
      detections.offer_strongest(range_m(alarms.random), signal,
                                 {.strength = strength, .number = alarms.number, .false_alarms = true}, alarms.tie);
  }
  LidarDetection& out = detections.out;
  out.count = static_cast<std::uint8_t>(std::min<std::size_t>(detections.count, 255));
  if (instrument_.velocity_noise_m_s > 0 && out.count > 0)
    out.velocity_noise_m_s = static_cast<float>(instrument_.velocity_noise_m_s) *
                             normal_one(bits_of(seed, scan, word_of(Purpose::velocity), beam)[0]);
  return out;
}

}  // namespace selenograph::engine
