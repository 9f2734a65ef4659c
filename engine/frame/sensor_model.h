// Optics and detector of a camera: SENSOR++ (Paproth et al.), section 2.3. Trusted values, like all requests to the
// engine.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "engine/frame/band.h"
#include "engine/frame/pose.h"
#include "engine/frame/truth.h"

namespace selenograph::engine {

// Point spread function: the share of a point's light that each pixel around it receives.
struct PointSpread {
  enum class Model {
    none,
    gaussian,  // standard deviation sigma_px, integrated over pixels
    airy,      // ideal circular aperture at the band's center wavelength, integrated over pixels
    kernel     // measured
  };
  Model model = Model::none;
  double sigma_px = 0;
  // side x side weights, row 0 on top, side odd: the light that each pixel receives from a point at the centre of the
  // middle pixel. Normalised on use.
  std::vector<double> kernel;
  int side = 0;
};

// Transmission of the optics as a function of the angle from the boresight.
struct Vignetting {
  enum class Model { none, cos4, table };
  Model model = Model::none;
  struct Point {
    double angle_deg, transmission;
  };
  std::vector<Point> table;  // angles increase from 0; linear in between, constant beyond the last
};

// Light that the surfaces of the optics scatter, by the law of Harvey & Shack (J. E. Harvey, PhD thesis, University of
// Arizona, 1976): BSDF = b0 (1 + (d / l)^2)^(s / 2), where d is the difference of the direction cosines.
struct StrayLight {
  double b0_sr = 0;     // sr^-1; 0: no light is scattered
  double shoulder = 0;  // l
  double slope = 0;     // s, negative
  // Largest angle from the boresight at which a Sun outside the image scatters into it.
  double sun_within_deg = 0;
  bool any() const { return b0_sr > 0; }
};

struct Optics {
  double f_number = 0;  // f_# of eqs. (8) and (9)
  PointSpread point_spread;
  Vignetting vignetting;
  StrayLight stray_light;
};

// A quantum detector, eq. (8), with its electronics. Electrons are e.
struct Detector {
  double pixel_pitch_um = 0;      // p
  double quantum_efficiency = 1;  // eta of optics and detector, 0 to 1
  // Relative eta by wavelength, multiplied by the above; linear between the points, 0 outside. Empty: 1.
  std::vector<ResponsePoint> efficiency;
  double integration_time_s = 0;  // t; 0: chosen by Exposure
  double full_well_e = 0;         // capacity of a pixel; 0: unlimited
  bool blooming = false;          // a full pixel's further electrons spill along its column
  double dark_current_e_s = 0;
  double smear_time_s = 0;     // frame transfer without shutter: time per row shift
  bool photon_noise = true;    // Poisson noise of photons and dark electrons
  double read_noise_e = 0;     // standard deviation
  double prnu = 0;             // relative standard deviation of the pixels' responses
  double dsnu_e = 0;           // standard deviation of the pixels' offsets
  double dead_fraction = 0;    // share of pixels without response
  double hot_fraction = 0;     // share of pixels with additional dark current
  double hot_current_e_s = 0;  // additional dark current of a hot pixel
  double gain_e_dn = 1;        // electrons per digital number
  double offset_dn = 0;
  int bit_depth = 8;  // 1 to 16: digital numbers from 0 to 2^bit_depth - 1
};

// The pixels of an image that automatic exposure brings to its target.
struct Metering {
  enum class Statistic { percentile, mean };

  ImageRegion region;
  Statistic statistic = Statistic::percentile;
  double percentile = 99.9;  // share of the region's pixels that stay within the target, %
};

// Automatic exposure. The integration time is chosen so that the metered pixels fill a share of the full well, or of
// the largest digital number, including smear, dark current and the offset, without noise and fixed pattern.
struct Exposure {
  double target_fill = 0;  // 0: the integration time is given
  double shortest_s = 1e-6, longest_s = 10;
  Metering metering;
};

// Camera motion during the exposure, from half the integration time before the pose's time to half after it. Light is
// averaged over `samples` exposure samples. Default: as many as the longest streak has pixels, an odd number, at most
// kMaxMoments.
struct Motion : Rates {
  std::optional<int> samples{};
  static constexpr int kMaxMoments = 65;
};

// Time delay and integration of a line camera: a row's charge is collected by `stages` lines of the detector, about
// that through the principal point, one after the other, and moves by one line per line time. Where it does not move as
// the image does, the row is blurred. Light is averaged over `samples` of the charge's places, as in Motion.
struct DelayedIntegration {
  int stages = 1;         // 1: none
  bool reversed = false;  // false: the charge moves up (-y), as the image does of a camera that flies along its +y
  std::optional<int> samples{};
  bool none() const { return stages == 1; }
};

struct SensorModel {
  Optics optics;
  Detector detector;
  Exposure exposure;
  Motion motion;
  DelayedIntegration tdi;
  std::uint64_t seed = 0;   // identifies a detector and its fixed pattern
  std::uint64_t frame = 0;  // number of the frame: each has its own noise
};

}  // namespace selenograph::engine
