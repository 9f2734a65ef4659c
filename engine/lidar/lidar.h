// Lidars: POST /v1/lidar. Directions of beams are in the camera axes of the pose (OpenCV: +z is the boresight).
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "engine/frame/pose.h"
#include "engine/frame/request.h"
#include "engine/frame/shutter.h"

namespace selenograph::engine {

struct LidarPulse {
  double time_s = 0;                // seconds from the time of the request's pose
  Vec3 direction = Vec3::unit_z();  // unit vector, camera axes
};

// Pattern of the beams in time and direction.
enum class LidarScan {
  flash,   // columns x rows beams at once, on a plane like a camera's pixels
  raster,  // columns x rows pulses one after the other, equal angles apart; every second row backwards if `serpentine`
  cone,    // `beams` pulses one after the other, around the boresight
  beams    // several beams at once in given directions
};
struct LidarPattern {
  LidarScan scan = LidarScan::flash;
  int columns = 0, rows = 0;            // flash, raster
  double fov_x_deg = 0, fov_y_deg = 0;  // full angles between the outer borders of cells; flash: square cells
  bool serpentine = false;              // raster
  int beams = 0;                        // cone: pulses per turn
  double half_angle_deg = 0;            // cone
  std::vector<Vec3> directions{};       // beams: unit
  double rate_hz = 0;                   // rate of pulses, or of the shots of `flash` and `beams`; 0: all at time 0
  int repeats = 1;
};

// Model of the received signal and its noise.
enum class LidarSignal {
  photon_counting,  // photoelectrons by the lidar equation; counts have Poisson statistics
  snr               // amplitude over the standard deviation of the noise, by its value for a reference target
};
struct LidarReceiver {
  LidarSignal signal = LidarSignal::photon_counting;
  // photon_counting: energy of a pulse, diameter of the aperture, photoelectrons per photon that arrives there
  double energy_j = 0, aperture_m = 0, efficiency = 1;
  // snr: signal-to-noise ratio for a Lambertian surface of this reflectance, viewed vertically from that range
  double snr = 0, range_m = 0, reflectance = 0.12;
};

// Ranges at which a return is accepted.
struct LidarGate {
  double near_m = 0, far_m = 0;
};

struct LidarInstrument {
  double divergence_mrad = 1;  // full angle at 1/e^2 of the intensity in the middle
  int sub_rays = 7;            // rays per beam: 1, 7, 19, 37, 61
  double pulse_length_ns = 2;  // full width at half maximum
  double wavelength_um = 1.064;
  LidarReceiver receiver;
  double threshold = 3;      // photoelectrons of a return, or its signal over the noise
  double dark_count_hz = 0;  // photon_counting: dark counts and stray light
  LidarGate gate;
  double timing_noise_ns = 0, velocity_noise_m_s = 0;  // standard deviations
  Vec3 offset_m = Vec3::zero();                        // offset of the aperture from the pose's position, camera axes
  std::optional<LidarPattern> pattern;
};

// Craters of the detail that are reported for beams.
struct LidarCraters {
  double smallest_m = 1;
  double least_depth = dem::Detail::kWorn;  // depth as a share of the diameter
};

struct LidarRequest {
  LidarInstrument instrument;
  // beams: single pulses, or a pattern
  std::vector<LidarPulse> pulses;
  LidarPattern pattern;
  Pose pose;
  Rates rates;                          // constant rates of motion from the pose on
  std::vector<PoseAtTime> poses;        // at least two poses, which replace pose and rates; empty: none
  std::uint64_t seed = 0, scan = 0;     // seed of the instrument's noise, and number of the scan
  std::optional<LidarCraters> craters;  // empty: none
  FrameRequest scenery;                 // request whose ground, objects and detail are scanned
};

// Results: a column for each member, a row for each beam in the order of the request; three numbers for a vector.
// Measured values are NaN without a detection, true values are NaN if the beam hits nothing.
struct LidarReturns {
  std::vector<double> time_s, origin_m, direction;  // origin, unit direction: MOON_ME
  // Measured values of the strongest, first and last detection.
  std::vector<double> range_m, first_m, last_m;
  std::vector<float> intensity, first_intensity, last_intensity;  // photoelectrons, or signal over noise
  std::vector<std::uint8_t> count;                                // number of detections, at most 255
  std::vector<float> velocity_m_s;  // velocity of the aperture along the beam, positive toward the surface
  // True values: centroid, standard deviation (of the echo, as a range) and mean signal of the strongest return; the
  // number of returns; the range at which the beam's axis hits the surface.
  std::vector<double> true_range_m, axis_range_m;
  std::vector<float> true_width_m, true_intensity, true_velocity_m_s;
  std::vector<std::uint8_t> true_count;
  std::vector<std::uint8_t> false_alarm;  // 1: range_m is a false alarm
  std::vector<std::uint16_t>
      object;  // index of the object that most of the strongest return comes from; 65535: ground, rock, none
  std::vector<std::uint64_t> rock;  // its dem::Rock::id; 0: none
  std::vector<std::uint64_t>
      crater;  // smallest crater that contains it, by dem::Crater::id; 0: none; empty: not requested
  std::size_t size() const { return time_s.size(); }
};

}  // namespace selenograph::engine
