// Turns the returns of an echo into a lidar's report: the lidar equation, detection, noise, false alarms.
#pragma once

#include <cstdint>
#include <span>

#include "engine/lidar/echo.h"
#include "engine/lidar/lidar.h"

namespace selenograph::engine {

// The report of one beam. Ranges are NaN without a detection.
struct LidarDetection {
  double strongest_m, first_m, last_m;
  float strongest, first, last;  // measured signals
  std::uint8_t count = 0;
  bool false_alarm = false;  // the strongest detection is a false alarm
  float velocity_noise_m_s = 0;
};

class LidarReceiverModel {
 public:
  explicit LidarReceiverModel(const LidarInstrument& instrument);

  // Returns the signal of a surface that fills the beam, per unit of mu0 f_r / R^2 (sr-1 m-2).
  //   photon_counting: photoelectrons by the lidar equation for extended targets, E_r = E_t mu0 f_r A / R^2 times the
  //   efficiency (Bufton, Proc. IEEE 77, 463, 1989, eq. 1, where a Lambertian surface has f_r = rho / pi), each of
  //   energy h c / wavelength.
  //   snr: the reference target's signal-to-noise ratio times its R^2 over its mu0 f_r.
  double gain() const { return gain_; }

  // Decides which returns are detected, and adds noise. The result is a function of seed, scan, beam and the returns.
  //   photon_counting: a Poisson count must reach the threshold. Its mean is the signal plus the dark counts within the
  //   return's full width at half maximum. The range's error is normal with deviation width / sqrt(count). The reported
  //   signal is the count minus the mean dark counts, which may be negative.
  //   snr: the signal plus a normal deviate of 1 must reach the threshold. The range's error is normal with deviation
  //   width / max(1, signal).
  //   Both: timing noise adds half the distance that light travels in it; no range becomes negative.
  //   False alarms: each resolution cell of one pulse length within the gate exceeds the threshold without light with a
  //   fixed chance, independently of the others; the range is uniform within the cell. Each alarm has the threshold's
  //   signal, and only the nearest and the farthest alarm are reported apart.
  //   The strongest detection has the highest count (dark counts included) or signal; ties, false alarms among them,
  //   are broken with equal chances.
  LidarDetection detect(std::span<const EchoReturn> returns, std::uint64_t seed, std::uint64_t scan,
                        std::uint32_t beam) const;

  double expected_false_alarms() const { return cells_ * alarm_chance_; }
  bool in_gate(double range_m) const { return range_m >= instrument_.gate.near_m && range_m <= instrument_.gate.far_m; }

 private:
  double dark_counts(double width_m) const;

  const LidarInstrument instrument_;
  double gain_, cell_m_;
  double cells_, alarm_chance_;  // cells of cell_m_ within the gate, and the chance of a false alarm in one
};

// Returns the probability that a Poisson count reaches a threshold.
double poisson_tail(double mean, double threshold);
// Returns the probability that a standard normal deviate exceeds x.
double normal_tail(double x);

}  // namespace selenograph::engine
