// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/sensor_json.h"

#include <fmt/format.h>

#include <variant>

#include "api/json/ranges.h"
#include "api/requests/parts/pose_json.h"
#include "api/requests/parts/region_json.h"
#include "api/schema/member_kinds.h"
#include "dem/base/error.h"
#include "engine/radiometry/spectrum.h"
#include "engine/sensor/optics.h"
#include "engine/sensor/stray_light.h"

namespace selenograph::api {
namespace {

using engine::DelayedIntegration;
using engine::Detector;
using engine::Metering;
using engine::Motion;
using engine::Optics;
using engine::PointSpread;
using engine::SensorModel;
using engine::StrayLight;
using engine::Vignetting;

constexpr Range kAboveZero = above(0).to(1e9);
constexpr Range kNotNegative{0, 1e9};
constexpr std::size_t kMaxKernelSide = 65;

constexpr std::pair<std::string_view, PointSpread::Model> kPointSpreads[] = {
    {"none", PointSpread::Model::none},
    {"gaussian", PointSpread::Model::gaussian},
    {"airy", PointSpread::Model::airy},
    {"kernel", PointSpread::Model::kernel},
};
constexpr std::pair<std::string_view, Vignetting::Model> kVignettings[] = {
    {"none", Vignetting::Model::none},
    {"cos4", Vignetting::Model::cos4},
    {"table", Vignetting::Model::table},
};

using Rows = std::vector<std::vector<double>>;

// "kernel": rows of weights in the request, or the name of a file in the assets folder.
struct Kernel {
  using Value = Rows;
  std::optional<Rows> read(const JsonReader& in, const ReadContext& context) const;
  OrderedJson write(const Rows& rows) const { return rows; }
  OrderedJson schema(const Limits& limits) const { return {{"anyOf", {kRows.schema(limits), {{"type", "string"}}}}}; }
  static inline const auto kRows = List{List{Number{kNotNegative}, 1, kMaxKernelSide}, 1, kMaxKernelSide};
};

std::optional<Rows> Kernel::read(const JsonReader& in, const ReadContext& context) const {
  const std::size_t before = in.faults();
  std::optional<Rows> rows;
  if (in.value().is_string()) {
    const auto file = Asset{&Assets::kernel, "kernel", "kernels"}.read(in, context);
    if (file) rows = *file->content;
  } else {
    rows = kRows.read(in, context);
  }
  if (!rows || in.faults() != before) return std::nullopt;
  // A file's rows are not checked by kRows: check all kernels alike.
  double sum = 0;
  bool fits = rows->size() % 2 == 1 && rows->size() <= kMaxKernelSide;
  for (const std::vector<double>& row : *rows) {
    fits &= row.size() == rows->size();
    for (const double weight : row) {
      fits &= kNotNegative.contains(weight);
      sum += weight;
    }
  }
  if (!fits)
    in.fail(fmt::format("must have as many columns as rows, an odd number up to {}, and no negative weight",
                        kMaxKernelSide));
  if (!(sum > 0)) in.fail("must not be 0 everywhere");
  return rows;
}

// Converts between the request's rows and the engine's kernel, a single array of side * side weights in row order.
const auto kernel_field =
    Property{[](const PointSpread& spread) -> std::optional<Rows> {
               Rows rows;
               for (auto row = spread.kernel.begin(); row != spread.kernel.end(); row += spread.side)
                 rows.emplace_back(row, row + spread.side);
               return rows.empty() ? std::nullopt : std::optional(std::move(rows));
             },
             [](PointSpread& spread, const Rows& rows) {
               spread.side = static_cast<int>(rows.size());
               for (const std::vector<double>& row : rows)
                 spread.kernel.insert(spread.kernel.end(), row.begin(), row.end());
             }};

// "quantum_efficiency": a number, or pairs [wavelength in um, number] at rising wavelengths.
struct Efficiency {
  using Curve = std::vector<engine::ResponsePoint>;
  using Value = std::variant<double, Curve>;
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const;
  OrderedJson write(const Value& value) const {
    if (const double* constant = std::get_if<double>(&value)) return *constant;
    return kCurve.write(std::get<Curve>(value));
  }
  OrderedJson schema(const Limits& limits) const {
    return {{"anyOf", {kConstant.schema(limits), kCurve.schema(limits)}}};
  }
  static inline const auto kConstant = Number{above(0).to(1)};
  static inline const auto kCurve = List{Pair<engine::ResponsePoint>{kWavelength_um, kUnitInterval}, 2, 1000};
};

std::optional<Efficiency::Value> Efficiency::read(const JsonReader& in, const ReadContext& context) const {
  if (!in.value().is_array()) {
    const auto constant = kConstant.read(in, context);
    return constant ? std::optional(Value(*constant)) : std::nullopt;
  }
  auto curve = kCurve.read(in, context);
  if (!curve) return std::nullopt;
  for (std::size_t i = 1; i < curve->size(); ++i)
    if (!((*curve)[i].wavelength_um > (*curve)[i - 1].wavelength_um)) {
      in.fail("its wavelengths must rise");
      return std::nullopt;
    }
  return Value(std::move(*curve));
}

// Converts between the request's "quantum_efficiency" and the engine's two members: a curve in `efficiency`, or, while
// that is empty, a constant in `quantum_efficiency`.
const auto efficiency_field = Property{[](const Detector& d) -> std::optional<Efficiency::Value> {
                                         if (d.efficiency.empty()) return d.quantum_efficiency;
                                         return d.efficiency;
                                       },
                                       [](Detector& d, const Efficiency::Value& value) {
                                         d.quantum_efficiency = 1;
                                         d.efficiency.clear();
                                         if (const double* constant = std::get_if<double>(&value))
                                           d.quantum_efficiency = *constant;
                                         else
                                           d.efficiency = std::get<Efficiency::Curve>(value);
                                       }};

// Field of the integration time; without a value where automatic exposure chooses it.
const auto integration_time_field =
    Property{[](const Detector& d) -> std::optional<double> {
               return d.integration_time_s > 0 ? std::optional(d.integration_time_s) : std::nullopt;
             },
             [](Detector& d, double seconds) { d.integration_time_s = seconds; }};

const Members<PointSpread>& point_spread_members() {
  static const auto table = make_table<Members<PointSpread>>(
      "PointSpread",
      "Point spread function, applied to radiance; the frame is rendered with a margin, so that the border is as exact "
      "as the middle.",
      [](auto& m) {
        m.add("model", &PointSpread::model, Word{kPointSpreads},
              "airy: ideal aperture of f_number at the band's center wavelength; wavelength times f_number is at most "
              "26 pixels; light beyond 12 rings or 32 pixels is spread within (captured_fraction)")
            .required();
        m.set_model("model");
        // Limit sigma so that the kernel, which extends to 4.5 sigma, has at most 65 x 65 weights.
        m.add("sigma_px", &PointSpread::sigma_px, Number{{0.01, 7}, "px"}, "standard deviation")
            .required()
            .only_for({"gaussian"});
        m.add("kernel", kernel_field, Kernel{},
              "measured kernel: rows of weights, or the name of kernels/NAME.csv, which holds such rows; as many "
              "columns as rows, an odd number; normalised to 1. The request in the metadata has the rows")
            .required()
            .only_for({"kernel"});
      });
  return *table;
}

const Members<Vignetting>& vignetting_members() {
  static const auto table = make_table<Members<Vignetting>>(
      "Vignetting", "Transmission of the optics by angle from the boresight.", [](auto& m) {
        m.add("model", &Vignetting::model, Word{kVignettings}, "vignetting function").required();
        m.set_model("model");
        m.add("table", &Vignetting::table, List{Pair<Vignetting::Point>{{0, 90}, kUnitInterval}, 1, 1000},
              "[degrees, transmission] at increasing angles; linear in between, constant beyond")
            .required()
            .only_for({"table"});
        m.check([](const JsonReader& in, Vignetting& vignetting, const ReadContext&) {
          for (std::size_t i = 1; i < vignetting.table.size(); ++i)
            if (!(vignetting.table[i].angle_deg > vignetting.table[i - 1].angle_deg))
              return in.fail("table", "its angles must rise");
        });
      });
  return *table;
}

const Members<StrayLight>& stray_light_members() {
  static const auto table = make_table<Members<StrayLight>>(
      "StrayLight",
      "Light that the surfaces of the optics scatter over the whole image: Harvey and Shack's law, b0 (1 + (d / "
      "shoulder)^2)^(slope / 2), d being the difference of the direction cosines. Light scattered out of the image is "
      "lost; only the Sun contributes from outside.",
      [](auto& m) {
        m.add("b0_sr", &StrayLight::b0_sr, Number{kAboveZero, "sr-1"}, "b0 of the law").required();
        m.add("shoulder", &StrayLight::shoulder, Number{{1e-6, 1}}, "difference of direction cosines").required();
        m.add("slope", &StrayLight::slope, Number{{-4, -0.1}}, "slope of the wings, as a power of that difference")
            .required();
        m.add("sun_within_deg", &StrayLight::sun_within_deg, Number{{0, 89}, "deg"},
              "a Sun outside the image, up to this angle from the boresight, adds the glare of its visible part; 0: "
              "never");
        m.check([](const JsonReader& in, StrayLight& law, const ReadContext&) {
          if (in.faults() > 0) return;
          if (const double share = engine::ScatteredLight::share(law); share > 0.5)
            in.fail("b0_sr", fmt::format("scatters {:.3g} of the light: at most a half is possible", share));
        });
      });
  return *table;
}

const Members<Optics>& optics_members() {
  static const auto table =
      make_table<Members<Optics>>("Optics", "Optics: f-number, point spread, vignetting.", [](auto& m) {
        m.add("f_number", &Optics::f_number, Number{kFNumber}, "focal length over aperture").required();
        m.add("point_spread", &Optics::point_spread, Object{point_spread_members()}, "left out: none");
        m.add("vignetting", &Optics::vignetting, Object{vignetting_members()}, "left out: none");
        m.add("stray_light", &Optics::stray_light, Object{stray_light_members()}, "left out: none")
            .written_if([](const Optics& optics) { return optics.stray_light.any(); });
      });
  return *table;
}

const Members<Detector>& detector_members() {
  static const auto table = make_table<
      Members<Detector>>("Detector", "A quantum detector: SENSOR++ eq. (8), and its electronics.", [](auto& m) {
    m.add("pixel_pitch_um", &Detector::pixel_pitch_um, Number{above(0).to(1e4), "um"}, "p of eq. (8)").required();
    m.add("quantum_efficiency", efficiency_field, Efficiency{},
          "eta of eq. (8), of optics and detector; or [wavelength in um, eta] at increasing wavelengths, linear in "
          "between, 0 outside")
        .required();
    m.add("integration_time_s", integration_time_field, Number{above(0).to(1e5), "s"},
          "t of eq. (8); left out where `exposure` chooses it");
    m.add("full_well_e", &Detector::full_well_e, Number{kNotNegative, "e"}, "capacity of a pixel; 0: unlimited");
    m.add(
        "blooming", &Detector::blooming, Flag{},
        "what exceeds a pixel's capacity spills along its column, half of it up and half down, until pixels have room");
    m.add("dark_current_e_s", &Detector::dark_current_e_s, Number{kNotNegative, "e/s"}, "dark current of each pixel");
    m.add("smear_time_s", &Detector::smear_time_s, Number{kNotNegative, "s"},
          "smear of frame transfer without a shutter: time per row shift");
    m.add("read_noise_e", &Detector::read_noise_e, Number{kNotNegative, "e"}, "standard deviation");
    m.add("prnu", &Detector::prnu, Number{kUnitInterval},
          "photo response non-uniformity: relative standard deviation of the pixels' responses");
    m.add("dsnu_e", &Detector::dsnu_e, Number{kNotNegative, "e"},
          "dark signal non-uniformity: standard deviation of the pixels' offsets");
    m.add("dead_fraction", &Detector::dead_fraction, Number{kUnitInterval}, "share of the pixels without response");
    m.add("hot_fraction", &Detector::hot_fraction, Number{kUnitInterval},
          "share of the pixels with additional dark current");
    m.add("hot_current_e_s", &Detector::hot_current_e_s, Number{kNotNegative, "e/s"},
          "additional dark current of a hot pixel");
    m.add("gain_e_dn", &Detector::gain_e_dn, Number{kAboveZero, "e/DN"},
          "electrons per digital number: with a larger one the same charge is darker")
        .required();
    m.add("offset_dn", &Detector::offset_dn, Number{{0, 65535}, "DN"}, "digital number without electrons");
    m.add("bit_depth", &Detector::bit_depth, Integer{1, 16},
          "digital numbers from 0 to 2^bit_depth - 1; the image is uint8 up to 8, else uint16");
    m.add("photon_noise", &Detector::photon_noise, Flag{}, "Poisson noise of photons and dark electrons");
    m.check([](const JsonReader& in, Detector& detector, const ReadContext&) {
      if (detector.dead_fraction + detector.hot_fraction > 1)
        in.fail("hot_fraction", "exceeds the share of pixels that are not dead");
      if (detector.blooming && detector.full_well_e == 0) in.fail("blooming", "needs \"full_well_e\"");
      if (const int max_dn = (1 << detector.bit_depth) - 1; !(detector.offset_dn < max_dn))
        in.fail("offset_dn",
                fmt::format("must be below {}, the largest digital number of {} bits", max_dn, detector.bit_depth));
    });
  });
  return *table;
}

constexpr std::pair<std::string_view, Metering::Statistic> kMeteringStatistics[] = {
    {"percentile", Metering::Statistic::percentile},
    {"mean", Metering::Statistic::mean},
};

const Members<Metering>& metering_members() {
  static const auto table = make_table<Members<Metering>>(
      "Metering", "The pixels that automatic exposure brings to `target_fill`, whatever they see.", [](auto& m) {
        m.add("region", &Metering::region, Object{region_members()}, "left out: the whole image")
            .written_if([](const Metering& metering) { return metering.region.width > 0; });
        m.add("statistic", &Metering::statistic, Word{kMeteringStatistics},
              "what reaches it: a percentile of the region's pixels, or their mean, unclipped");
        m.add("percentile", &Metering::percentile, Number{{0, 100}, "%"},
              "share of the pixels that stay within it; the brighter ones exceed it")
            .only_for({"percentile"});
        m.set_model("statistic");
      });
  return *table;
}

const Members<engine::Exposure>& exposure_members() {
  static const auto table = make_table<Members<engine::Exposure>>(
      "Exposure",
      "Automatic exposure: the integration time is chosen from the frame at the middle of the exposure, so that the "
      "metered pixels, by default all but the brightest thousandth, stay within a share of the full well and of the "
      "largest digital number, including smear, dark current and the offset, without noise and fixed pattern. The "
      "metadata has the time; there is a warning if smear alone exceeds the share, or a limit cuts the time.",
      [](auto& m) {
        m.add("target_fill", &engine::Exposure::target_fill, Number{above(0).to(1)},
              "share of the full well and of the largest digital number: whichever is reached first")
            .required();
        m.add("shortest_s", &engine::Exposure::shortest_s, Number{above(0).to(1e5), "s"}, "shortest integration time");
        m.add("longest_s", &engine::Exposure::longest_s, Number{above(0).to(1e5), "s"}, "longest integration time");
        m.add("metering", &engine::Exposure::metering, Object{metering_members()}, "by which pixels");
        m.check([](const JsonReader& in, engine::Exposure& exposure, const ReadContext&) {
          if (exposure.longest_s < exposure.shortest_s) in.fail("longest_s", "is less than shortest_s");
        });
      });
  return *table;
}

const Members<Motion>& motion_members() {
  static const auto table = make_table<Members<Motion>>(
      "Motion",
      "Camera motion during the exposure, whose middle is the pose: light is averaged over several moments. Other "
      "products are those of the pose.",
      [](auto& m) {
        m.add("angular_rate_deg_s", &Motion::angular_rate_deg_s, kAngularRate_deg_s,
              "angular rate about the camera's own axes (opencv)");
        m.add("velocity_m_s", &Motion::velocity_m_s, kVelocity_m_s, "velocity of the camera, MOON_ME");
        m.add("samples", &Motion::samples, Integer{1, 256},
              fmt::format("number of moments; left out: the length of the longest streak in pixels, at most {}",
                          Motion::kMaxMoments));
      });
  return *table;
}

const Members<DelayedIntegration>& tdi_members() {
  static const auto table = make_table<Members<DelayedIntegration>>(
      "Tdi",
      "Time delay and integration of a pushbroom: a row's charge is collected by several lines of the detector, about "
      "that through cy, one after the other, and moves continuously by one line per line_time_s. Where the image moves "
      "otherwise, as its rates and the ground say, the row is blurred; motion.longest_streak_px has by how much. All "
      "light is collected within integration_time_s, at most stages x line_time_s. `prnu` and `dsnu_e` are those of "
      "the columns read out. Other products are those of the middle line.",
      [](auto& m) {
        m.add("stages", &DelayedIntegration::stages, Integer{2, 1024}, "lines that collect a row's charge").required();
        m.add("reversed", &DelayedIntegration::reversed, Flag{},
              "false: the charge moves up (-y), for a camera that flies along its +y; true: down");
        m.add(
            "samples", &DelayedIntegration::samples, Integer{1, 256},
            fmt::format("places of the charge over which light is averaged; left out: the longest streak in pixels, at "
                        "most {}",
                        Motion::kMaxMoments));
      });
  return *table;
}

}  // namespace

const Members<SensorModel>& sensor_members() {
  static const auto table = make_table<Members<SensorModel>>(
      "Sensor",
      "Makes `image` from radiance: vignetting, point spread, stray light, electrons (SENSOR++ eq. 8), smear, PRNU, "
      "dark current, photon noise, full well, DSNU, read noise, gain, offset, digital numbers. Needs a `band`; "
      "excludes "
      "`image`. Noise is a function of seed, frame, pixel and source: the same request gives the same bytes.",
      [](auto& m) {
        m.add("optics", &SensorModel::optics, Object{optics_members()}, "from radiance to irradiance").required();
        m.add("detector", &SensorModel::detector, Object{detector_members()}, "from irradiance to digital numbers")
            .required();
        m.add("exposure", &SensorModel::exposure, Object{exposure_members()},
              "automatic exposure, instead of the detector's integration_time_s")
            .written_if([](const SensorModel& sensor) { return sensor.exposure.target_fill > 0; });
        m.add("motion", &SensorModel::motion, Object{motion_members()}, "left out: none")
            .written_if([](const SensorModel& sensor) { return !sensor.motion.none(); });
        m.add("tdi", &SensorModel::tdi, Object{tdi_members()}, "of a pushbroom; left out: a single line")
            .written_if([](const SensorModel& sensor) { return !sensor.tdi.none(); });
        m.add("seed", &SensorModel::seed, Integer{0, kMaxSeed}, "identifies the detector and its fixed pattern");
        m.add("frame", &SensorModel::frame, Integer{0, kMaxSeed}, "number of the frame: each has its own noise");
        m.check([](const JsonReader& in, SensorModel& sensor, const ReadContext&) {
          if (in.faults() > 0) return;  // the detector may be incomplete
          // Exactly one of the detector and the automatic exposure gives the integration time.
          const bool is_fixed = sensor.detector.integration_time_s > 0;
          const bool is_automatic = sensor.exposure.target_fill > 0;
          if (is_fixed && is_automatic)
            in.fail(
                "exposure",
                "chooses the integration time, and so does detector.integration_time_s; null takes a preset's away");
          if (!is_fixed && !is_automatic)
            in.at("detector").fail("integration_time_s", "is required, or the sensor's exposure");
          // The exposure aims at a share of the largest digital number. If the offset alone exceeds it, no integration
          // time is short enough.
          const engine::Detector& d = sensor.detector;
          if (const int max_dn = (1 << d.bit_depth) - 1;
              is_automatic && !(sensor.exposure.target_fill * max_dn > d.offset_dn))
            in.at("exposure")
                .fail("target_fill",
                      fmt::format("must be more than the detector's offset_dn over {}, the largest digital "
                                  "number: no light is left",
                                  max_dn));
        });
      });
  return *table;
}

namespace {

// Reports an efficiency curve that is 0 in the whole band.
void check_efficiency(const JsonReader& in, const engine::SensorModel& sensor, const engine::Band& band) {
  // A constant efficiency is above 0 by its range; in_photons() rejects a curve without response in the band.
  if (sensor.detector.efficiency.empty()) return;
  try {
    engine::in_photons(band, sensor.detector.efficiency);
  } catch (const ImpossibleRequest&) {
    const JsonReader model = in.at("sensor");
    model.at("detector").fail("quantum_efficiency", "is 0 all over the band");
  }
}

// Reports an Airy disc that is too wide for its kernel, at all three members from which its width follows: any of them
// may be wrong.
void check_airy(const JsonReader& in, const engine::SensorModel& sensor, const engine::Band& band) {
  if (sensor.optics.point_spread.model != engine::PointSpread::Model::airy) return;
  // The disc's width on the detector is proportional to wavelength times f-number.
  constexpr double kMaxWidth_px = engine::SpreadKernel::kMaxAiry_px;
  const double width_px = band.center_um() * sensor.optics.f_number / sensor.detector.pixel_pitch_um;
  if (width_px <= kMaxWidth_px) return;
  const std::string why =
      fmt::format("with \"airy\", wavelength * f_number / pixel_pitch_um must be at most {:g} pixels; it is {:g}",
                  kMaxWidth_px, width_px);
  const JsonReader model = in.at("sensor");
  model.at("optics").fail("f_number", why);
  model.at("detector").fail("pixel_pitch_um", why);
  in.fail("band", why);
}

// Reports a pixel pitch of the camera that differs from the detector's. The camera's converts its focal length to
// pixels, the detector's gives the pixel's area: both are the same pixel.
void check_pitch(const JsonReader& in, const engine::SensorModel& sensor) {
  if (!in.has("camera")) return;
  const JsonReader camera = in.at("camera");
  const double detector_pitch_um = sensor.detector.pixel_pitch_um;
  if (camera.has("pixel_pitch_um") && camera.at("pixel_pitch_um").value() != detector_pitch_um)
    camera.fail("pixel_pitch_um", fmt::format("must be that of the sensor: \"sensor.detector.pixel_pitch_um\" is {:g}",
                                              detector_pitch_um));
}

// Reports stray light of a fisheye: the scattering kernel is defined for an image on a plane.
void check_stray_light(const JsonReader& in, const engine::FrameRequest& request) {
  if (!request.sensor->optics.stray_light.any() || !request.camera.beyond_plane()) return;
  const JsonReader model = in.at("sensor");
  model.at("optics").fail("stray_light", "is not modelled for a fisheye's image");
}

// Reports effects of the sensor that are computed on a whole image, as if all rows were exposed at once. A `shutter`
// (times per row: rolling shutter or line camera) exposes them one after the other.
void check_sensor_with_shutter(const JsonReader& in, const engine::SensorModel& sensor,
                               const engine::Shutter& shutter) {
  const JsonReader model = in.at("sensor");
  if (!sensor.motion.none())
    model.fail("motion", "cannot be combined with \"shutter\": motion blur is not modelled for rows with times");
  if (sensor.detector.smear_time_s > 0)
    model.at("detector").fail("smear_time_s", "is of frame transfer: a \"shutter\" reads row by row");
  if (!shutter.pushbroom) return;
  const std::string why =
      "must be left out (or null, if a preset has it) with a pushbroom: neighbouring rows of its image are not "
      "neighbours on the detector";
  if (sensor.detector.blooming) model.at("detector").fail("blooming", why);
  if (sensor.optics.point_spread.model != engine::PointSpread::Model::none)
    model.at("optics").fail("point_spread", why);
  if (sensor.optics.stray_light.any()) model.at("optics").fail("stray_light", why);
}

}  // namespace

void check_sensor(const JsonReader& in, const engine::FrameRequest& request) {
  const engine::SensorModel& sensor = *request.sensor;
  if (const engine::ImageRegion& region = sensor.exposure.metering.region; region.width > 0)
    check_region(in.at("sensor").at("exposure").at("metering"), region, request.camera);
  if (request.shutter) check_sensor_with_shutter(in, sensor, *request.shutter);
  if (!sensor.tdi.none() && !(request.shutter && request.shutter->pushbroom))
    in.at("sensor").fail("tdi", "needs a \"shutter\" with \"pushbroom\": true: rows that one line images in turn");
  check_pitch(in, sensor);
  check_stray_light(in, request);
  if (!request.band) return;
  check_airy(in, sensor, *request.band);
  check_efficiency(in, sensor, *request.band);
}

}  // namespace selenograph::api
