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

// What the words of a beam are for.
enum class Purpose : std::uint64_t { false_alarms = 0, velocity = 1, strongest_alarm = 2, first_return = 16 };

std::uint64_t word_of(Purpose purpose) { return static_cast<std::uint64_t>(purpose); }

// (word block, scan, purpose) is the frame of the numbers: scans are below 2^53, word blocks below 2^6.
RandomBits bits_of(std::uint64_t seed, std::uint64_t scan, std::uint64_t purpose, std::uint32_t beam,
                   std::uint64_t word_block = 0) {
  return draw_one(seed, word_block << 58 | scan << 5 | purpose, RandomSource::lidar, beam);
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

// False alarms of a beam. Each cell of the gate has one with the same chance, so the number of cells without an alarm
// before the next one has a geometric distribution. Places are in cells from the near end of the gate.
class AlarmCells {
 public:
  AlarmCells(double cells, double chance) : cells_(cells), chance_(chance), log_of_none_(std::log1p(-chance)) {}

  struct Alarms {
    double number = 0;  // beyond kMaxDrawn its expected value
    double nearest = 0, farthest = 0, any = 0;
    std::uint32_t tie = 0;  // random bits that choose among equally strong detections
  };
  Alarms draw(std::uint64_t seed, std::uint64_t scan, std::uint32_t beam) const {
    std::array<double, kMaxDrawn> places;
    std::size_t drawn = 0;
    RandomBits bits{};
    for (double cell = -1; drawn < kMaxDrawn; ++drawn) {
      if (drawn % 4 == 0) bits = bits_of(seed, scan, word_of(Purpose::false_alarms), beam, drawn / 4);
      const std::uint32_t word = bits[drawn % 4];
      cell += 1 + cells_without(word);
      // A cell has many words: multiplied by an odd number, they are uniform within it.
      places[drawn] = cell + unit(word * 0x9E3779B1U);
      if (!(places[drawn] < cells_)) break;
    }
    if (drawn == 0) return {};
    const RandomBits more = bits_of(seed, scan, word_of(Purpose::strongest_alarm), beam);
    const auto number = static_cast<double>(drawn);
    const double last = places[drawn - 1], choice = unit(more[0]);
    if (drawn < kMaxDrawn) return {number, places[0], last, places[static_cast<std::size_t>(choice * number)], more[3]};
    const double farthest = std::max(last, cells_ - cells_without(more[1]) - unit(more[2]));
    return {number + chance_ * (cells_ - last), places[0], farthest, choice * cells_, more[3]};
  }

 private:
  static constexpr std::size_t kMaxDrawn = 256;
  double cells_without(std::uint32_t word) const { return std::floor(std::log(unit(word)) / log_of_none_); }

  double cells_, chance_, log_of_none_;
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
    : instrument_(instrument),
      gain_(gain_of(instrument)),
      cell_m_(kHalfLight_m_ns * instrument.pulse_length_ns),
      cells_((instrument.gate.far_m - instrument.gate.near_m) / cell_m_),
      alarm_chance_(instrument.receiver.signal == LidarSignal::snr
                        ? normal_exceeds(instrument.threshold)
                        : poisson_reaches(dark_counts(cell_m_), instrument.threshold)) {}

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
    const RandomBits bits = bits_of(seed, scan, word_of(Purpose::first_return) + k % Echo::kMost, beam);
    const double full_width_m = std::max(cell_m_, kFullWidth * one.width_m);
    const double dark = counting ? dark_counts(full_width_m) : 0;
    const double found = counting ? static_cast<double>(poisson_one(bits[0], static_cast<float>(one.signal + dark)))
                                  : one.signal + static_cast<double>(normal_one(bits[0]));
    if (!(found >= instrument_.threshold)) continue;
    const double deviation_m = counting ? one.width_m / std::sqrt(found) : one.width_m / std::max(1.0, one.signal);
    const double noise_m = deviation_m * static_cast<double>(normal_one(bits[1])) +
                           timing_m * static_cast<double>(normal_one(bits[2])),
                 range_m = std::max(0.0, one.range_m + noise_m), signal = found - dark;
    all.add(range_m, signal);
    all.take_strongest(range_m, signal, {.strength = found, .number = 1, .false_alarms = false}, bits[3]);
  }
  constexpr double kMinAlarms = 1e-12;
  if (expected_false_alarms() > kMinAlarms) {
    const AlarmCells::Alarms alarms = AlarmCells(cells_, alarm_chance_).draw(seed, scan, beam);
    const auto range_m = [&](double cell) { return instrument_.gate.near_m + cell_m_ * cell; };
    // Hardly any alarm is stronger than the threshold asks for.
    const double strength = counting ? std::ceil(instrument_.threshold) : instrument_.threshold,
                 signal = counting ? strength - dark_counts(cell_m_) : strength;
    if (alarms.number > 0) all.add(range_m(alarms.nearest), signal);
    if (alarms.number > 1) all.add(range_m(alarms.farthest), signal);
    if (alarms.number > 2) all.count += static_cast<std::size_t>(std::min(alarms.number - 2, 255.0));
    if (alarms.number > 0)
      all.take_strongest(range_m(alarms.any), signal,
                         {.strength = strength, .number = alarms.number, .false_alarms = true}, alarms.tie);
  }
  LidarDetection& out = all.out;
  out.count = static_cast<std::uint8_t>(std::min<std::size_t>(all.count, 255));
  if (instrument_.velocity_noise_m_s > 0 && out.count > 0)
    out.velocity_noise_m_s = static_cast<float>(instrument_.velocity_noise_m_s) *
                             normal_one(bits_of(seed, scan, word_of(Purpose::velocity), beam)[0]);
  return out;
}

}  // namespace selenograph::engine
