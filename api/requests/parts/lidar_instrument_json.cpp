// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/lidar_instrument_json.h"

#include <fmt/format.h>

#include "api/json/ranges.h"

namespace selenograph::api {
namespace {

using engine::LidarInstrument;
using engine::LidarPattern;
using engine::LidarPulse;
using engine::LidarReceiver;
using engine::LidarScan;
using engine::LidarSignal;

constexpr std::pair<std::string_view, LidarScan> kScans[] = {
    {"flash", LidarScan::flash}, {"raster", LidarScan::raster}, {"cone", LidarScan::cone}, {"beams", LidarScan::beams}};
constexpr std::pair<std::string_view, LidarSignal> kSignals[] = {{"photon_counting", LidarSignal::photon_counting},
                                                                 {"snr", LidarSignal::snr}};
constexpr std::int64_t kMaxBeamsAlongSide = 65536, kMaxRepeats = std::int64_t{1} << 24;
constexpr std::size_t kMaxDirections = 4096;
constexpr Range kPositive = above(0).to(1e9);

const Members<LidarReceiver>& receiver_members() {
  static const auto table = make_table<Members<LidarReceiver>>(
      "LidarReceiver",
      "Received signal of a pulse, and noise. `photon_counting`: photoelectrons by the lidar equation, energy_j times "
      "mu0 f_r aperture / range^2 times efficiency, f_r at zero phase; counts have Poisson statistics. `snr`: a signal "
      "in units of the noise's standard deviation, proportional to mu0 f_r / range^2; the range's error follows from "
      "the "
      "signal without noise.",
      [](auto& m) {
        m.add("signal", &LidarReceiver::signal, Word{kSignals}, "model of the received signal").required();
        m.set_model("signal");
        m.add("energy_j", &LidarReceiver::energy_j, Number{above(0).to(1e3), "J"}, "energy of a pulse")
            .required()
            .only_for({"photon_counting"});
        m.add("aperture_m", &LidarReceiver::aperture_m, Number{above(0).to(100), "m"}, "the receiver's diameter")
            .required()
            .only_for({"photon_counting"});
        m.add("efficiency", &LidarReceiver::efficiency, Number{above(0).to(1)},
              "photoelectrons per incident photon: optics, filter, detector")
            .only_for({"photon_counting"});
        m.add("snr", &LidarReceiver::snr, Number{kPositive},
              "signal-to-noise ratio of a Lambertian surface that fills the beam, seen vertically from `range_m`")
            .required()
            .only_for({"snr"});
        m.add("range_m", &LidarReceiver::range_m, Number{kPositive, "m"},
              "range of the Lambertian surface that `snr` refers to")
            .required()
            .only_for({"snr"});
        m.add("reflectance", &LidarReceiver::reflectance, Number{{1e-6, 1}},
              "reflectance of the Lambertian surface that `snr` refers to")
            .only_for({"snr"});
      });
  return *table;
}

}  // namespace

const Members<LidarPulse>& lidar_pulse_members() {
  static const auto table = make_table<Members<LidarPulse>>("LidarPulse", "A pulse.", [](auto& m) {
    m.add("direction", &LidarPulse::direction, Vector{kAnyNumber}, "camera axes; any length but zero").required();
    m.add("time_s", &LidarPulse::time_s, Number{{-1e6, 1e6}, "s"}, "time relative to `pose`");
    m.resolve([](const JsonReader& in, const LidarPulse& pulse, const ReadContext&) -> std::optional<LidarPulse> {
      if (const auto direction = direction_of(pulse.direction)) return LidarPulse{pulse.time_s, *direction};
      in.fail("direction", "is not a direction: three numbers are required, not all zero");
      return std::nullopt;
    });
  });
  return *table;
}

const Members<LidarPattern>& lidar_pattern_members() {
  static const auto table = make_table<Members<LidarPattern>>(
      "LidarPattern",
      "Times and directions of the beams. `flash`: all cells of a rectangle at once, equal squares on a plane like a "
      "camera's pixels. `raster`: cells one after the other, row by row, equal angles apart: about the camera's y axis "
      "along a row, about x from row to row. `cone`: pulses around the boresight, beginning at +x toward +y. `beams`: "
      "given directions, all at once.",
      [](auto& m) {
        m.add("scan", &LidarPattern::scan, Word{kScans}, "kind of scan").required();
        m.set_model("scan");
        m.add("columns", &LidarPattern::columns, Integer{1, kMaxBeamsAlongSide}, "beams of a row")
            .required()
            .only_for({"flash", "raster"});
        m.add("rows", &LidarPattern::rows, Integer{1, kMaxBeamsAlongSide}, "rows, the first at -y")
            .required()
            .only_for({"flash", "raster"});
        m.add("fov_x_deg", &LidarPattern::fov_x_deg, Number{above(0).to(179), "deg"},
              "full angle of a row, from the outer border of its first cell to that of its last")
            .required()
            .only_for({"flash", "raster"});
        m.add("fov_y_deg", &LidarPattern::fov_y_deg, Number{above(0).to(179), "deg"}, "full angle over all rows")
            .required()
            .only_for({"raster"});
        m.add("serpentine", &LidarPattern::serpentine, Flag{}, "alternate rows are scanned backwards")
            .only_for({"raster"});
        m.add("beams", &LidarPattern::beams, Integer{1, std::int64_t{1} << 24}, "pulses per turn")
            .required()
            .only_for({"cone"});
        m.add("half_angle_deg", &LidarPattern::half_angle_deg, Number{{0, 90}, "deg"},
              "angle of the pulses from the boresight")
            .required()
            .only_for({"cone"});
        m.add("directions", &LidarPattern::directions, List{Vector{kAnyNumber}, 1, kMaxDirections},
              "camera axes; any length but zero")
            .required()
            .only_for({"beams"});
        m.add("rate_hz", &LidarPattern::rate_hz, Number{{0, 1e12}, "Hz"},
              "pulses, or shots of `flash` and `beams`, per second, the first at the time of `pose`; 0: all at that "
              "time");
        m.add("repeats", &LidarPattern::repeats, Integer{1, kMaxRepeats}, "number of times the pattern is fired");
        m.check([](const JsonReader& in, LidarPattern& pattern, const ReadContext&) {
          for (Vec3& direction : pattern.directions) {
            const auto unit = direction_of(direction);
            if (!unit) return in.fail("directions", "has one that is zero: not a direction");
            // Leave a unit vector as it is: normalising again could change its last bits, and so the ETag.
            direction = is_unit(direction) ? direction : *unit;
          }
        });
      });
  return *table;
}

const Members<LidarInstrument>& lidar_instrument_members() {
  static const auto table = make_table<Members<LidarInstrument>>(
      "LidarInstrument", "A lidar with Gaussian beams, sampled by sub-rays that each represent a part of the beam.",
      [](auto& m) {
        m.add("divergence_mrad", &LidarInstrument::divergence_mrad, Number{{0, 200}, "mrad"},
              "full angle of a beam at 1/e^2 of the central intensity; 0: a line")
            .required();
        m.add("sub_rays", &LidarInstrument::sub_rays, Choice{{1, 7, 19, 37, 61}},
              "of a beam. An edge divides a beam by whole sub-rays: the share of light on either side is off by up to "
              "0.5, 0.34, 0.23, 0.17 and 0.13 of the beam's");
        m.add("pulse_length_ns", &LidarInstrument::pulse_length_ns, Number{above(0).to(1e6), "ns"},
              "full width at half maximum of a Gaussian pulse")
            .required();
        m.add("wavelength_um", &LidarInstrument::wavelength_um, Number{{0.1, 100}, "um"},
              "wavelength of the photons and of the ground's reflectance")
            .required();
        m.add("receiver", &LidarInstrument::receiver, Object{receiver_members()},
              "converts the light from the ground to a signal")
            .required();
        m.add("threshold", &LidarInstrument::threshold, Number{kPositive},
              "minimum signal of a detection: photoelectrons, or multiples of the noise")
            .required();
        m.add("dark_count_hz", &LidarInstrument::dark_count_hz, Number{{0, 1e12}, "Hz"},
              "dark counts and stray light; only of `photon_counting`, since `snr` includes the noise");
        m.add("range_gate_m", &LidarInstrument::gate, Pair<engine::LidarGate>{{0, 1e9}, {0, 1e9}},
              "[nearest, farthest] range of a detection, m")
            .required();
        m.add("timing_noise_ns", &LidarInstrument::timing_noise_ns, Number{{0, 1e6}, "ns"},
              "standard deviation of the measured time, added to the echo's");
        m.add("velocity_noise_m_s", &LidarInstrument::velocity_noise_m_s, Number{{0, 1e6}, "m/s"},
              "standard deviation of the velocity along a beam");
        m.add("offset_m", &LidarInstrument::offset_m, Vector{{-1e4, 1e4}, "m"},
              "position of the aperture relative to the pose, camera axes");
        m.add("pattern", &LidarInstrument::pattern, Object{lidar_pattern_members()},
              "default for requests that have neither `pattern` nor `pulses`");
        m.check([](const JsonReader& in, LidarInstrument& instrument, const ReadContext&) {
          const auto [near_m, far_m] = instrument.gate;
          if (in.has("range_gate_m") && !(near_m < far_m))
            in.fail("range_gate_m", fmt::format("begins at {:g} m and ends at {:g} m: its ends cross", near_m, far_m));
        });
      });
  return *table;
}

}  // namespace selenograph::api
