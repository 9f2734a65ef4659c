// A camera's optics and detector: SENSOR++ (Paproth et al.), section 2.3. Trusted values, like all of frame.h.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "engine/frame/band.h"
#include "engine/frame/pose.h"

namespace selenograph::engine {

// How much of a point's light arrives in each pixel around it.
struct PointSpread {
  enum class Model {
    none,
    gaussian,  // of standard deviation sigma_px, integrated over pixels
    airy,      // of a circular aperture without aberrations, at the band's center wavelength, integrated over pixels
    kernel     // as measured
  };
  Model model = Model::none;
  double sigma_px = 0;
  // side x side weights, row 0 on top, side odd: of what a point at the middle pixel's center leaves in the pixels
  // around it. Normalised where they are used.
  std::vector<double> kernel;
  int side = 0;
};

// Transmission of the optics by the angle from the boresight.
struct Vignetting {
  enum class Model { none, cos4, table };
  Model model = Model::none;
  struct Point {
    double angle_deg, transmission;
  };
  std::vector<Point> table;  // angles rise from 0; linear in between, the last one's transmission beyond
};

struct Optics {
  double f_number = 0;  // f_# of eqs. (8) and (9)
  PointSpread point_spread;
  Vignetting vignetting;
};

// A quantum detector, eq. (8), and what its electronics add. Electrons are e.
struct Detector {
  double pixel_pitch_um = 0;      // p
  double quantum_efficiency = 1;  // eta: of optics and detector, 0 to 1
  // eta by wavelength: times the above; linear between the points, 0 outside. Empty: 1.
  std::vector<ResponsePoint> efficiency;
  double integration_time_s = 0;  // t; 0: as Exposure says
  double full_well_e = 0;         // a pixel holds no more; 0: any number
  double dark_current_e_s = 0;
  double smear_time_s = 0;     // that a row passes each row of the image in, unshuttered: frame transfer
  bool photon_noise = true;    // photons and dark electrons arrive one by one: Poisson
  double read_noise_e = 0;     // standard deviation
  double prnu = 0;             // standard deviation of the pixels' responses, relative
  double dsnu_e = 0;           // standard deviation of the pixels' offsets
  double dead_fraction = 0;    // of the pixels that see nothing
  double hot_fraction = 0;     // of the pixels whose dark current is
  double hot_current_e_s = 0;  // higher by this
  double gain_e_dn = 1;        // electrons per digital number
  double offset_dn = 0;
  int bit_depth = 8;  // 1 to 16: digital numbers from 0 to 2^bit_depth - 1
};

// Chooses the integration time from the frame: all but the brightest thousandth of the pixels stay within a share of
// what a pixel holds, or of what the largest digital number stands for, with smear and dark current, without noise and
// fixed pattern.
struct Exposure {
  double target_fill = 0;  // 0: the integration time is given
  double shortest_s = 1e-6, longest_s = 10;
};

// What the camera does while it is exposed, from half the integration time before the pose's moment to half after it:
// light is averaged over so many moments in between. Left out: as many as the longest streak has pixels, an odd number,
// kMostMoments at most.
struct Motion : Rates {
  std::optional<int> samples{};
  static constexpr int kMostMoments = 65;
};

struct SensorModel {
  Optics optics;
  Detector detector;
  Exposure exposure;
  Motion motion;
  std::uint64_t seed = 0;   // one detector's: its fixed pattern follows from it
  std::uint64_t frame = 0;  // another one has other noise
};

}  // namespace selenograph::engine
