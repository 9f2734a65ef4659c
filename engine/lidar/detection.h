// From the returns of an echo to what a lidar reports: the lidar equation, detection, noise, false alarms.
#pragma once

#include <cstdint>
#include <span>

#include "engine/frame/lidar.h"
#include "engine/lidar/echo.h"

namespace selenograph::engine {

// The report of one beam. Ranges are NaN without a detection.
struct LidarDetection {
  double strongest_m, first_m, last_m;
  float strongest, first, last;  // measured signals
  std::uint8_t count = 0;
  bool false_alarm = false;  // the strongest
  float velocity_noise_m_s = 0;
};

class LidarReceiverModel {
 public:
  explicit LidarReceiverModel(const LidarInstrument& instrument);

  // Signal of a surface that fills the beam, over mu0 f_r / R^2 (sr-1 m-2). photon_counting: photoelectrons by the
  // lidar equation for extended targets, E_r = E_t mu0 f_r A / R^2 times the efficiency (Bufton, Proc. IEEE 77, 463,
  // 1989, eq. 1, where a Lambertian surface has f_r = rho / pi), each of h c / wavelength. snr: that of the reference
  // target times its R^2 over its mu0 f_r.
  double gain() const { return gain_; }

  // Whether a return is detected is a function of seed, scan, beam and the return's number; so is its noise.
  //   photon_counting: a count of Poisson statistics, whose mean is the signal and the dark counts within the return's
  //   full width at half maximum, must reach the threshold. Its range is off by a normal deviate of width /
  //   sqrt(count). The reported signal is the count minus the mean dark counts, which may be negative. snr: the signal
  //   and a normal deviate of 1 must reach the threshold. The range is off by width / max(1, signal).
  // Both: and by half of the way of light in the timing noise, but no range is negative. False alarms: each resolution
  // cell of one pulse length within the gate exceeds the threshold without light by its chance, independently of the
  // others; the range is uniform within the cell. Each alarm has what the threshold asks for, and only the nearest and
  // the farthest are told apart. Of detections with the highest count (dark counts included) or signal, false alarms
  // among them, each is as likely the strongest.
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

// The chance that a count of Poisson statistics reaches a threshold.
double poisson_reaches(double mean, double threshold);
// The chance that a normal deviate exceeds a number.
double normal_exceeds(double x);

}  // namespace selenograph::engine
