// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
//
// Tables of an answer's members (api/schema/answers.h). A row is a.add(name in JSON, JSON Schema, function that returns
// the value, condition); a member without a condition is always written.
#include "api/requests/mertis_json.h"

#include <fmt/format.h>

#include <algorithm>

#include "api/json/ranges.h"
#include "api/schema/member_kinds.h"
#include "dem/base/error.h"

namespace selenograph::api {
namespace {

using engine::SpectrometerChannel;

// "efficiency": a number for all wavelengths, or a curve. A number becomes a curve of one point at wavelength 0, which
// check_mertis moves to first_um.
struct SpectrometerEfficiency {
  using Value = std::vector<engine::EfficiencyPoint>;
  std::optional<Value> read(const JsonReader& in, const ReadContext& context) const {
    if (!in.value().is_number()) return read_curve(in, context);
    const auto eta = in.number(kUnitInterval);
    return eta ? std::optional(Value{{0, *eta}}) : std::nullopt;
  }
  OrderedJson write(const Value& curve) const { return kCurve.write(curve); }
  OrderedJson schema(const Limits& limits) const {
    return {{"oneOf", {number_schema(kUnitInterval), kCurve.schema(limits)}}};
  }
  OrderedJson fallback() const { return engine::Spectrometer().efficiency[0].efficiency; }

 private:
  static std::optional<Value> read_curve(const JsonReader& in, const ReadContext& context) {
    const auto curve = kCurve.read(in, context);
    if (!curve) return std::nullopt;
    std::size_t i = 0;
    in.elements(1, curve->size(), [&](const JsonReader& point) {
      if (i > 0 && !((*curve)[i].wavelength_um > (*curve)[i - 1].wavelength_um)) point.fail("wavelengths must rise");
      ++i;
    });
    return curve;
  }
  static inline const auto kCurve = List{Pair<engine::EfficiencyPoint>{kWavelength_um, kUnitInterval}, 1, 1000};
};

// Reports channels so narrow, or so near to 0, that the difference of their ends in double precision would have too few
// correct digits for the quantities computed from it.
void check_widths(const JsonReader& in, const engine::Spectrometer& s) {
  constexpr double kMinRelativeWidth = 1e-9;
  const double width_um = (s.last_um - s.first_um) / s.channels;
  if (s.first_um < kMinRelativeWidth * width_um)
    in.fail("first_um", fmt::format("is too near to 0 for channels of {:g} um", width_um));
  if (width_um < kMinRelativeWidth * s.last_um)
    in.fail("channels", fmt::format("of {:g} um at {:g} um are too narrow", width_um, s.last_um));
}

void check_mertis(const JsonReader& in, MertisQuery& query, const ReadContext&) {
  engine::Spectrometer& s = query.spectrometer;
  if (!(s.last_um > s.first_um)) return in.fail("last_um", "must be above first_um");
  check_widths(in, s);
  // A constant efficiency, given or default, is listed in the answer at the first wavelength.
  if (!in.has("efficiency") || in.at("efficiency").value().is_number()) s.efficiency[0].wavelength_um = s.first_um;
}

constexpr const char* kAssumptions[] = {
    "SENSOR++ prints 80 channels from 7 to 14 um and equations (3), (9) and (12); it does not print what follows",
    "channels of equal width",
    "f/2 and pixels of 35 um (Hiesinger, Helbert et al. 2010)",
    "efficiency of optics and grating 0.3 at all wavelengths",
    "noise-equivalent power 1 pW per channel, after averaging over frames",
    "blackbodies of 350 and 500 K",
};

// Returns, for each temperature, the channels' signals for a blackbody.
OrderedJson spectra_json(const SpectraSource& s) {
  OrderedJson spectra = OrderedJson::array();
  for (const double kelvin : s.query.temperatures_k) {
    OrderedJson channels = OrderedJson::array();
    for (const SpectrometerChannel& c : engine::look_at_blackbody(s.query.spectrometer, kelvin, s.stop))
      channels.push_back({{"center_um", c.center_um},
                          {"width_um", c.width_um},
                          {"radiance_w_m2_sr_um", c.radiance_w_m2_sr_um},
                          {"flux_w", c.flux_w},
                          {"noise_equivalent_power_w", s.query.spectrometer.noise_equivalent_power_w},
                          {"signal_to_noise", c.signal_to_noise},
                          {"width_error", c.width_error}});
    spectra.push_back({{"temperature_k", kelvin}, {"channels", channels}});
  }
  return spectra;
}

}  // namespace

const Members<MertisQuery>& mertis_members() {
  static const auto table = make_table<Members<MertisQuery>>(
      "MertisRequest",
      "A spectrometer observing blackbodies: SENSOR++ eqs. (3), (9), (12). Defaults are those of MERTIS, or "
      "assumptions: the answer lists them.",
      [](auto& m) {
        using engine::Spectrometer;
        const auto spectrometer = [](auto Spectrometer::*field) { return nested(&MertisQuery::spectrometer, field); };
        m.add("description", no_field<MertisQuery, std::string>(), Text{}, "description in a file; ignored");
        m.add("first_um", spectrometer(&Spectrometer::first_um), Number{kWavelength_um, "um"},
              "lower end of the first channel");
        m.add("last_um", spectrometer(&Spectrometer::last_um), Number{kWavelength_um, "um"},
              "upper end of the last channel");
        m.add("channels", spectrometer(&Spectrometer::channels), Integer{1, kMaxChannels},
              "number of channels of equal width");
        m.add("pixel_pitch_um", spectrometer(&Spectrometer::pixel_pitch_um), Number{above(0).to(1e4), "um"}, "p");
        m.add("f_number", spectrometer(&Spectrometer::f_number), Number{kFNumber}, "f_#");
        m.add("efficiency", spectrometer(&Spectrometer::efficiency), SpectrometerEfficiency{},
              "eta of optics and grating: a constant, or [um, eta] at increasing wavelengths");
        m.add("noise_equivalent_power_w", spectrometer(&Spectrometer::noise_equivalent_power_w),
              Number{above(0).to(1), "W"}, "NEP of a pixel");
        m.add("temperatures_k", &MertisQuery::temperatures_k, List{Number{{1, 1e4}}, 1, 16, "K"},
              "temperatures of the blackbodies");
        m.check(check_mertis);
      });
  return *table;
}

MertisQuery read_mertis(const Json& body) { return mertis_members().read_body(body, {Limits{}, Assets{}}); }

const Answer<SpectraSource>& mertis_answer() {
  using S = SpectraSource;
  using namespace schema;
  static const auto answer = make_answer<S>("Per temperature and channel.", [](auto& a) {
    const OrderedJson channel = free_object(
        "center_um, width_um, radiance_w_m2_sr_um (B(T)), flux_w (eq. 9), noise_equivalent_power_w, signal_to_noise "
        "(eq. 12), width_error: of L Delta lambda against the integral, relative");
    a.add("instrument", with_keyword(ref("MertisRequest"), "description", "as understood"),
          [](const S& s) { return mertis_members().write(s.query); });
    a.add("assumptions_of_the_defaults", array(text("an assumption")),
          [](const S&) { return OrderedJson(kAssumptions); });
    a.add("spectra",
          array(object("", {{"temperature_k", number(kAnyNumber, "K")}, {"channels", array(channel)}},
                       {"temperature_k", "channels"})),
          spectra_json);
  });
  return answer;
}

}  // namespace selenograph::api
